"""Attention of every 3D point over its nearest points of all views."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

from fecocodec.geometry.neighbours import nearest_neighbours

NUM_HEADS = 4
OFFSET_CHANNELS = 4  # relative position (3) and its length
LEAST_PRESENCE = 1e-6  # of a neighbour: were it zero, points that all lie in one place would have none
POINTS_AT_ONCE = 4096  # whose neighbours' keys and values are gathered; more are slower, for want of cache
LARGEST_OFFSET = 4.0  # offsets are measured in depths of the point; farther ones are clamped


class NeighbourAttention(nn.Module):
    """Points and features of one scene -> features, by attention over the k nearest points (Zhao et al., "Point
    Transformer", 2021, reduced to scalar attention with a relative position bias).

    Offsets are rotated into the camera that saw the point and divided by its depth: the result depends neither on the
    unit of length nor on the world's axes. A neighbour as far as the nearest point left out has no weight: which of the
    two is chosen, rounding decides, and on another machine otherwise.
    """

    head_of_channel: Float[Tensor, "attention head"]  # 0 or 1

    def __init__(self, channels: int, attention_channels: int, num_neighbours: int, fade: float) -> None:
        """fade: share of the squared distance to the nearest point left out, over which weights fall to nothing."""
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

    def forward(
        self,
        features: Float[Tensor, "point channel"],
        points: Float[Tensor, "point 3"],
        depth: Float[Tensor, " point"],
        world_to_view: Float[Tensor, "point 3 3"],
    ) -> Float[Tensor, "point channel"]:
        """What to add to the features.

        points: world frame. depth: of each point in the view that saw it. world_to_view: rotation of that view.

        Block by block: what is gathered outweighs all else by far.
        """
        neighbours, presence = self._neighbours(points)
        normed = self.norm(features)
        key_value, query = self.key_value(normed), self.query_scale * self.query(normed)
        of_points = (neighbours, presence, query, points, depth, world_to_view)
        blocks = zip(*(x.split(POINTS_AT_ONCE) for x in of_points), strict=True)
        return self.output(torch.cat([self._gather(key_value, points, *block) for block in blocks]))

    def _gather(
        self,
        key_value: Float[Tensor, "point attention2"],
        places: Float[Tensor, "point 3"],
        neighbours: Int[Tensor, "asking k"],
        presence: Float[Tensor, "asking k"],
        query: Float[Tensor, "asking attention"],
        points: Float[Tensor, "asking 3"],
        depth: Float[Tensor, " asking"],
        world_to_view: Float[Tensor, "asking 3 3"],
    ) -> Float[Tensor, "asking gathered"]:
        """What some points find among their neighbours, all of whose keys, values and places are given.

        All heads share one batched product each way, by queries that are zero outside their head's channels: at these
        sizes that beats splitting and copying.
        """
        offsets = _relative_offsets(F.embedding(neighbours, places) - points[:, None], depth, world_to_view)
        # `embedding` picks rows like an index, but much faster, and so its gradient
        key, value = F.embedding(neighbours, key_value).chunk(2, dim=-1)  # [asking k attention]
        logits = key @ (query[..., None] * self.head_of_channel) + self.offset_bias(offsets) + presence.log()[..., None]
        weights = logits.softmax(dim=1).transpose(1, 2)  # [asking head k]
        gathered = ((weights @ value) * self.head_of_channel.T).sum(dim=1)
        return torch.cat((gathered, rearrange(weights @ offsets, "p head c -> p (head c)")), dim=-1)

    def _neighbours(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Indices of the k nearest points, and how far each is present, LEAST_PRESENCE to 1: [point k] both."""
        if len(points) <= self.num_neighbours:  # no point is left out
            neighbours = nearest_neighbours(points, self.num_neighbours)
            return neighbours, torch.ones_like(neighbours, dtype=points.dtype)
        neighbours = nearest_neighbours(points, self.num_neighbours + 1)
        distance = (F.embedding(neighbours, points) - points[:, None]).square().sum(dim=-1)
        beyond = distance.amax(dim=1, keepdim=True)
        presence = (beyond - distance) / (self.fade * beyond).clamp(min=1e-30)
        return neighbours[:, :-1], presence[:, :-1].clamp(LEAST_PRESENCE, 1.0)


def _relative_offsets(
    offsets: Float[Tensor, "point k 3"], depth: Float[Tensor, " point"], world_to_view: Float[Tensor, "point 3 3"]
) -> Float[Tensor, "point k 4"]:
    """Offsets in world axes -> in view axes, in units of depth, and their lengths."""
    offsets = offsets / depth[:, None, None]
    offsets = (offsets @ world_to_view.transpose(-1, -2)).clamp(-LARGEST_OFFSET, LARGEST_OFFSET)
    length = offsets.square().sum(dim=-1, keepdim=True).add(1e-12).sqrt()
    return 10.0 * torch.cat((offsets, length), dim=-1)  # neighbours lie near 0.01 to 0.1 depths away
