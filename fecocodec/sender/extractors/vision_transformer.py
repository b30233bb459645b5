"""The vision transformers ViT-S/14 and ViT-B/14 of DINOv2 (Oquab et al., "DINOv2", 2023), without the mask token."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

CHANNELS, PATCH = 384, 14  # width of ViT-S; side of a patch in pixels
IMAGENET_MEAN, IMAGENET_DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_DEPTH, _HEAD_CHANNELS = 12, 64
_TRAINED_SIDE = 37  # side of the trained position embedding, in patches
_OFFSET = 0.1  # added to the number of patches when the embedding is resized, as in DINOv2
_EPSILON = 1e-6
_FIRST_SCALE = 1e-5  # of LayerScale, before training
Tokens = Float[Tensor, "item token channel"]
Pictures = Float[Tensor, "item 3 h w"]


def normalised(images: Pictures) -> Pictures:
    """Return images, sRGB in [0, 1], with the mean and the standard deviation of ImageNet removed."""
    mean, deviation = (images.new_tensor(x)[:, None, None] for x in (IMAGENET_MEAN, IMAGENET_DEVIATION))
    return (images - mean) / deviation


class LayerScale(nn.Module):
    """Learned factor for each channel."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.gamma = nn.Parameter(torch.full((channels,), _FIRST_SCALE))

    def forward(self, x: Float[Tensor, "*batch channel"]) -> Float[Tensor, "*batch channel"]:
        return x * self.gamma


class Attention(nn.Module):
    """Self-attention over all tokens of a view."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.qkv, self.proj = nn.Linear(channels, 3 * channels), nn.Linear(channels, channels)

    def forward(self, x: Tokens) -> Tokens:
        query, key, value = rearrange(self.qkv(x), "i t (three n c) -> three i n t c", three=3, c=_HEAD_CHANNELS)
        attended = F.scaled_dot_product_attention(query, key, value)
        return self.proj(rearrange(attended, "i n t c -> i t (n c)"))


class Mlp(nn.Module):
    """Linear -> GELU -> linear."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(channels, 4 * channels), nn.Linear(4 * channels, channels)

    def forward(self, x: Tokens) -> Tokens:
        return self.fc2(F.gelu(self.fc1(x)))


class Block(nn.Module):
    """Pre-norm attention and MLP, each with LayerScale and a residual connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(channels, _EPSILON), nn.LayerNorm(channels, _EPSILON)
        self.attn, self.mlp = Attention(channels), Mlp(channels)
        self.ls1, self.ls2 = LayerScale(channels), LayerScale(channels)

    def forward(self, x: Tokens) -> Tokens:
        x = x + self.ls1(self.attn(self.norm1(x)))
        return x + self.ls2(self.mlp(self.norm2(x)))


class PatchEmbedding(nn.Module):
    """Map each patch of 14x14 pixels to a token."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(3, channels, PATCH, stride=PATCH)

    def forward(self, images: Pictures) -> Float[Tensor, "item channel rows columns"]:
        return self.proj(images)


class VisionTransformer(nn.Module):
    """image -> patch tokens + position embedding -> twelve blocks -> norm -> feature map with one vector per patch."""

    def __init__(self, channels: int = CHANNELS) -> None:
        super().__init__()
        self.patch_embed = PatchEmbedding(channels)
        self.cls_token = nn.Parameter(torch.zeros(1, 1, channels))
        self.pos_embed = nn.Parameter(torch.zeros(1, 1 + _TRAINED_SIDE**2, channels))
        self.blocks = nn.ModuleList(Block(channels) for _ in range(_DEPTH))
        self.norm = nn.LayerNorm(channels, _EPSILON)
        nn.init.trunc_normal_(self.pos_embed, std=0.02)
        nn.init.normal_(self.cls_token, std=1e-6)

    def forward(self, images: Pictures) -> Float[Tensor, "item channel rows columns"]:
        """Return the features after the last block and the norm. images: `normalised`; sides multiples of 14."""
        return self.maps(images, (_DEPTH - 1,))[0]

    def maps(self, images: Pictures, blocks: tuple[int, ...]) -> list[Tensor]:
        """Return the features after each of these blocks, in their order, and the norm. Arguments as for `forward`."""
        patches = self.patch_embed(images)
        rows, columns = patches.shape[-2:]
        tokens = rearrange(patches + self._positions(rows, columns), "i c h w -> i (h w) c")
        first = (self.cls_token + self.pos_embed[:, :1]).expand(len(images), -1, -1)
        tokens = torch.cat((first, tokens), dim=1)
        found = []
        for number, block in enumerate(self.blocks):
            tokens = block(tokens)
            if number in blocks:
                found.append(rearrange(self.norm(tokens)[:, 1:], "i (h w) c -> i c h w", h=rows))
        return found

    def _positions(self, rows: int, columns: int) -> Float[Tensor, "1 channel rows columns"]:
        """Return the position embedding, resized from 37x37 patches."""
        trained = rearrange(self.pos_embed[:, 1:], "1 (h w) c -> 1 c h w", h=_TRAINED_SIDE)
        if rows == columns == _TRAINED_SIDE:
            return trained
        scale = ((rows + _OFFSET) / _TRAINED_SIDE, (columns + _OFFSET) / _TRAINED_SIDE)
        return F.interpolate(trained, scale_factor=scale, mode="bicubic", align_corners=False)
