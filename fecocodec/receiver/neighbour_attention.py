"""KNN attention: each 3D point attends to its nearest points of all views."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

from fecocodec.geometry.neighbours import nearest_neighbours

NUM_HEADS = 4
OFFSET_CHANNELS = 4  # relative position (3) and its length
LEAST_PRESENCE = 1e-6  # lower bound of a neighbour's weight, so that coinciding points have neighbours
POINTS_AT_ONCE = 4096  # points per block; larger blocks exceed the cache and are slower
LARGEST_OFFSET = 4.0  # in units of the point's depth; larger offsets are clamped


class NeighbourAttention(nn.Module):
    """Attention over the k nearest points: points and features of one scene -> residual features.

    Zhao et al., "Point Transformer", 2021, with scalar attention and a relative position bias. Offsets are rotated to
    the frame of the point's camera and divided by the point's depth, so that the result depends neither on the unit of
    length nor on the world frame. The weight vanishes at the distance of neighbour k + 1, so that rounding errors in
    the choice of neighbours do not change the result.
    """

    head_of_channel: Float[Tensor, "attention head"]  # 0 or 1

    def __init__(self, channels: int, attention_channels: int, num_neighbours: int, fade: float) -> None:
        """fade: range over which weights fall to zero, as a share of the squared distance to neighbour k + 1."""
        super().__init__()
        self.num_neighbours, self.fade = num_neighbours, fade
        heads = torch.eye(NUM_HEADS).repeat_interleave(attention_channels // NUM_HEADS, dim=0)
        self.register_buffer("head_of_channel", heads, persistent=False)
        self.query_scale = (attention_channels // NUM_HEADS) ** -0.5
        self.norm = nn.LayerNorm(channels)
        self.query = nn.Linear(channels, attention_channels)
        self.key_value = nn.Linear(channels, 2 * attention_channels)
        self.offset_bias = nn.Sequential(nn.Linear(OFFSET_CHANNELS, 16), nn.ReLU(), nn.Linear(16, NUM_HEADS))
        self.output = nn.Linear(attention_channels + NUM_HEADS * OFFSET_CHANNELS, channels)

    def search(self, points: Float[Tensor, "point 3"]) -> Int[Tensor, "point k1"]:
        """Return the indices of the k + 1 nearest points of each point, or of k if there are no more points."""
        is_one_left = len(points) > self.num_neighbours
        return nearest_neighbours(points, self.num_neighbours + is_one_left)

    def forward(
        self,
        neighbours: Int[Tensor, "point k1"],
        features: Float[Tensor, "point channel"],
        points: Float[Tensor, "point 3"],
        depth: Float[Tensor, " point"],
        world_to_view: Float[Tensor, "point 3 3"],
    ) -> Float[Tensor, "point channel"]:
        """Return the residual to add to the features.

        neighbours: of `search`. points: in the world frame. depth: of each point in its own view. world_to_view:
        rotation of that view. Points are processed in blocks, because gathered keys and values dominate the memory.
        """
        key_value, query = self.keys_values_and_queries(features)
        keys, values = (half.contiguous() for half in key_value.chunk(2, dim=-1))
        blocks = zip(*(x.split(POINTS_AT_ONCE) for x in (neighbours, query, points, depth, world_to_view)), strict=True)
        return self.output(torch.cat([self.gathered(keys, values, points, *block) for block in blocks]))

    def keys_values_and_queries(
        self, features: Float[Tensor, "point channel"]
    ) -> tuple[Float[Tensor, "point attention2"], Float[Tensor, "point attention"]]:
        """Return keys and values, side by side, and queries of points."""
        normed = self.norm(features)
        return self.key_value(normed), self.query_scale * self.query(normed)

    def gathered(
        self,
        keys: Float[Tensor, "point attention"],
        values: Float[Tensor, "point attention"],
        all_points: Float[Tensor, "point 3"],
        neighbours: Int[Tensor, "asking k1"],
        query: Float[Tensor, "asking attention"],
        points: Float[Tensor, "asking 3"],
        depth: Float[Tensor, " asking"],
        world_to_view: Float[Tensor, "asking 3 3"],
    ) -> Float[Tensor, "asking gathered"]:
        """Return attended values and attended offsets of a block of points. keys, values and all_points: of all.

        All heads share one batched product per direction, with queries that are zero outside their head's channels,
        which is faster at these sizes than splitting the heads.
        """
        offsets = F.embedding(neighbours, all_points) - points[:, None]
        presence = self._presence(neighbours, offsets)
        neighbours = neighbours[:, : self.num_neighbours]
        offsets = _relative_offsets(offsets[:, : self.num_neighbours], depth, world_to_view)
        # `embedding` is much faster than indexing, and so is its gradient.
        key, value = F.embedding(neighbours, keys), F.embedding(neighbours, values)  # [asking k attention]
        logits = key @ (query[..., None] * self.head_of_channel) + self.offset_bias(offsets) + presence.log()[..., None]
        weights = logits.softmax(dim=1).transpose(1, 2)  # [asking head k]
        gathered = ((weights @ value) * self.head_of_channel.transpose(0, 1)).sum(dim=1)
        return torch.cat((gathered, rearrange(weights @ offsets, "p head c -> p (head c)")), dim=-1)

    def _presence(
        self, neighbours: Int[Tensor, "asking k1"], offsets: Float[Tensor, "asking k1 3"]
    ) -> Float[Tensor, "asking k"]:
        """Return the weights in [LEAST_PRESENCE, 1] of the k nearest points."""
        if neighbours.shape[1] == self.num_neighbours:  # no point is left out
            return torch.ones_like(neighbours, dtype=offsets.dtype)
        distance = offsets.square().sum(dim=-1)
        beyond = distance.amax(dim=1, keepdim=True)
        presence = (beyond - distance) / (self.fade * beyond).clamp(min=1e-30)
        return presence[:, :-1].clamp(LEAST_PRESENCE, 1.0)


def _relative_offsets(
    offsets: Float[Tensor, "point k 3"], depth: Float[Tensor, " point"], world_to_view: Float[Tensor, "point 3 3"]
) -> Float[Tensor, "point k 4"]:
    """Transform offsets from the world frame to the view frame, in units of depth; also returns their lengths."""
    offsets = offsets / depth[:, None, None]
    offsets = (offsets @ world_to_view.transpose(-1, -2)).clamp(-LARGEST_OFFSET, LARGEST_OFFSET)
    length = offsets.square().sum(dim=-1, keepdim=True).add(1e-12).sqrt()
    return 10.0 * torch.cat((offsets, length), dim=-1)  # typical offsets are 0.01 to 0.1
