"""The DPT head: maps of a ViT, joined with those of the other branches, at full resolution (Ranftl et al., 2021)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.layers.blocks import FeatureMaps
from fecocodec.sender.extractors.depthsplat_small.backbone import MIDDLE, OUTPUT, STEM, resized

VIT_CHANNELS, FINE_CHANNELS = 768, 64  # of the ViT; of multi-view features at the finer scale
_WIDTHS = (96, 192, 384, 768)  # at 1/2, 1/4, 1/8, 1/16
_LAST_WIDTH = 16  # of the layers that predict depth


class ResidualUnit(nn.Module):
    """x + two (ReLU, 3x3 conv)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1, self.conv2 = (nn.Conv2d(channels, channels, 3, padding=1) for _ in range(2))

    def forward(self, x: FeatureMaps) -> FeatureMaps:
        return x + self.conv2(F.relu(self.conv1(F.relu(x))))


class Refinement(nn.Module):
    """coarse map (+ residual unit of a finer map) -> residual unit -> 1x1 conv -> resized, in the faster order."""

    def __init__(self, channels: int, has_finer: bool) -> None:
        super().__init__()
        if has_finer:
            self.resConfUnit1 = ResidualUnit(channels)
        self.resConfUnit2, self.out_conv = ResidualUnit(channels), nn.Conv2d(channels, channels, 1)

    def forward(self, x: FeatureMaps, finer: Tensor | None, size: tuple[int, int]) -> Float[Tensor, "item channel _ _"]:
        x = x if finer is None else x + self.resConfUnit1(finer)
        return resized(self.out_conv(self.resConfUnit2(x)), size)


class DptHead(nn.Module):
    """Four maps of the ViT -> 1/2 to 1/16 -> joined with CNN and multi-view features -> refined from coarse to fine."""

    def __init__(self, channels: int, lowest: int, predicts_depth: bool = False) -> None:
        """channels: of the features. lowest: see `DepthSplatBase.arrange`. predicts_depth: map the features to a
        correction of a depth, which is an input, too."""
        super().__init__()
        half, quarter, eighth, last = _WIDTHS
        fine = FINE_CHANNELS + predicts_depth
        if lowest == 4:
            joined = (STEM + MIDDLE + fine + half, OUTPUT + quarter + OUTPUT, eighth)
        else:
            joined = (STEM + half, MIDDLE + quarter + fine, OUTPUT + eighth + OUTPUT)
        self.projects = nn.ModuleList(nn.Conv2d(VIT_CHANNELS, width, 1) for width in _WIDTHS)
        self.resize_layers = nn.ModuleList([nn.ConvTranspose2d(half, half, 4, 4)])
        self.resize_layers += [nn.ConvTranspose2d(quarter, quarter, 2, 2), nn.Identity()]
        self.resize_layers += [nn.Conv2d(last, last, 3, stride=2, padding=1)]
        self.concat_projects = nn.ModuleList(nn.Conv2d(n, w, 1) for n, w in zip(joined, _WIDTHS[:3], strict=True))
        self.scratch = nn.ModuleDict()
        for number, width in enumerate(_WIDTHS, 1):
            self.scratch[f"layer{number}_rn"] = nn.Conv2d(width, channels, 3, padding=1, bias=False)
            self.scratch[f"refinenet{number}"] = Refinement(channels, has_finer=number < len(_WIDTHS))
        self.lowest, self.predicts_depth = lowest, predicts_depth
        if predicts_depth:
            layers = edge_conv(channels, channels // 2), nn.GELU(), edge_conv(channels // 2, _LAST_WIDTH), nn.GELU()
            self.scratch["output_conv"] = nn.Sequential(*layers, nn.Conv2d(_LAST_WIDTH, 1, 1))

    def forward(
        self,
        monocular: list[Float[Tensor, "item vit h8 w8"]],
        appearance: tuple[Tensor, Tensor, Tensor],
        multi_view: tuple[Tensor, Tensor],
        depth: tuple[Float[Tensor, "item 1 _ _"], ...] = (),
    ) -> FeatureMaps:
        """Return the features, or the correction of the inverse depth `depth`, at full resolution.

        Other arguments: see `extractor.Maps`. The order of what is joined is the public network's.
        """
        maps = [self.resize_layers[i](self.projects[i](x)) for i, x in enumerate(monocular)]
        first, second, third = appearance
        coarse, fine = multi_view
        if self.lowest == 4:
            joined = [(first, second, fine, *depth, maps[0]), (third, maps[1], coarse), (maps[2],)]
        else:
            joined = [(first, maps[0]), (second, maps[1], fine, *depth), (third, maps[2], coarse)]
        maps[:3] = [project(torch.cat(x, dim=1)) for project, x in zip(self.concat_projects, joined, strict=True)]
        sizes = [(2 * maps[0].shape[-2], 2 * maps[0].shape[-1]), *(x.shape[-2:] for x in maps[:3])]
        own = [self.scratch[f"layer{number}_rn"](x) for number, x in enumerate(maps, 1)]
        path: Tensor = self.scratch["refinenet4"](own[3], None, sizes[3])
        for i in (2, 1, 0):
            path = self.scratch[f"refinenet{i + 1}"](path, own[i], sizes[i])
        return self.scratch["output_conv"](path) if self.predicts_depth else path


def edge_conv(in_channels: int, channels: int) -> nn.Conv2d:
    """Return a 3x3 convolution that repeats the values at the edge."""
    return nn.Conv2d(in_channels, channels, 3, padding=1, padding_mode="replicate")
