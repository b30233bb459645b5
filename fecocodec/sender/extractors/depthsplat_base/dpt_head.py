"""The DPT head: maps of a ViT, joined with those of the other branches, at full resolution (Ranftl et al., 2021)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.sender.extractors.depthsplat_small.backbone import MIDDLE, OUTPUT, STEM, resized

VIT_CHANNELS = 768
FINE_CHANNELS = 64  # multi-view features at 1/2
_WIDTHS = (96, 192, 384, 768)  # at 1/2, 1/4, 1/8, 1/16
_LAST_WIDTH = 16  # of the layers that predict depth


class ResidualUnit(nn.Module):
    """x + two (ReLU, 3x3 conv)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1, self.conv2 = (nn.Conv2d(channels, channels, 3, padding=1) for _ in range(2))

    def forward(self, x: Float[Tensor, "item channel h w"]) -> Float[Tensor, "item channel h w"]:
        return x + self.conv2(F.relu(self.conv1(F.relu(x))))


class Refinement(nn.Module):
    """coarse map (+ residual unit of a finer map) -> residual unit -> resized -> 1x1 conv."""

    def __init__(self, channels: int, has_finer: bool = True) -> None:
        super().__init__()
        if has_finer:
            self.resConfUnit1 = ResidualUnit(channels)
        self.resConfUnit2 = ResidualUnit(channels)
        self.out_conv = nn.Conv2d(channels, channels, 1)

    def forward(
        self,
        coarse: Float[Tensor, "item channel h w"],
        finer: Float[Tensor, "item channel h w"] | None,
        size: tuple[int, int],
    ) -> Float[Tensor, "item channel _ _"]:
        """size: of the result. A 1x1 convolution before the resizing gives the same as after it, in less time."""
        joined = coarse if finer is None else coarse + self.resConfUnit1(finer)
        return resized(self.out_conv(self.resConfUnit2(joined)), size)


class DptHead(nn.Module):
    """Four maps of the ViT -> 1/2 to 1/16 -> joined with CNN and multi-view features -> refined from coarse to fine."""

    def __init__(self, channels: int, predicts_depth: bool = False) -> None:
        """channels: of the features. predicts_depth: map them to a correction of a depth, which is an input, too."""
        super().__init__()
        halves, quarters, eighths, sixteenths = _WIDTHS
        self.projects = nn.ModuleList(nn.Conv2d(VIT_CHANNELS, width, 1) for width in _WIDTHS)
        self.resize_layers = nn.ModuleList(
            [
                nn.ConvTranspose2d(halves, halves, 4, stride=4),
                nn.ConvTranspose2d(quarters, quarters, 2, stride=2),
                nn.Identity(),
                nn.Conv2d(sixteenths, sixteenths, 3, stride=2, padding=1),
            ]
        )
        joined = (STEM + MIDDLE + FINE_CHANNELS + predicts_depth + halves, OUTPUT + quarters + OUTPUT, eighths)
        self.concat_projects = nn.ModuleList(
            nn.Conv2d(inputs, width, 1) for inputs, width in zip(joined, _WIDTHS[:3], strict=True)
        )
        layers: dict[str, nn.Module] = {}
        for number, width in enumerate(_WIDTHS, 1):
            layers[f"layer{number}_rn"] = nn.Conv2d(width, channels, 3, padding=1, bias=False)
            layers[f"refinenet{number}"] = Refinement(channels, has_finer=number < len(_WIDTHS))
        if predicts_depth:
            layers["output_conv"] = _depth_layers(channels)
        self.predicts_depth, self.scratch = predicts_depth, nn.ModuleDict(layers)

    def forward(
        self,
        monocular: list[Float[Tensor, "item vit h8 w8"]],
        appearance: tuple[Tensor, Tensor, Tensor],
        multi_view: tuple[Tensor, Tensor],
        inverse_depth: Float[Tensor, "item 1 h2 w2"] | None = None,
    ) -> Float[Tensor, "item channel h w"]:
        """Return the features, or the correction of inverse depth, at full resolution.

        appearance: at 1/2, 1/2 and 1/4. multi_view: at 1/4 and 1/2.
        """
        maps = [self.resize_layers[i](self.projects[i](x)) for i, x in enumerate(monocular)]
        depth = () if inverse_depth is None else (inverse_depth,)
        maps[0] = self.concat_projects[0](torch.cat((*appearance[:2], multi_view[1], *depth, maps[0]), dim=1))
        maps[1] = self.concat_projects[1](torch.cat((appearance[2], maps[1], multi_view[0]), dim=1))
        maps[2] = self.concat_projects[2](maps[2])
        rows, columns = maps[0].shape[-2:]
        sizes = [(2 * rows, 2 * columns), *((x.shape[-2], x.shape[-1]) for x in maps[:3])]
        maps = [self.scratch[f"layer{number}_rn"](x) for number, x in enumerate(maps, 1)]
        path = self.scratch["refinenet4"](maps[3], None, sizes[3])
        for number in (3, 2, 1):
            path = self.scratch[f"refinenet{number}"](path, maps[number - 1], sizes[number - 1])
        return self.scratch["output_conv"](path) if self.predicts_depth else path


def _depth_layers(channels: int) -> nn.Sequential:
    """Return the layers that map features to one number."""
    first, second, last = (
        nn.Conv2d(channels, channels // 2, 3, padding=1, padding_mode="replicate"),
        nn.Conv2d(channels // 2, _LAST_WIDTH, 3, padding=1, padding_mode="replicate"),
        nn.Conv2d(_LAST_WIDTH, 1, 1),
    )
    return nn.Sequential(first, nn.GELU(), second, nn.GELU(), last)
