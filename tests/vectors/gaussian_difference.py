"""How far two machines' Gaussians of one stream are apart, in the terms of FORMAT.md, section 15."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.receiver.decode import read_cameras
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from tests.vectors.gaussian_samples import nearest_depth

SPECIFICATION = Path(__file__).resolve().parents[2] / "bitstream_spec"


@dataclass(frozen=True)
class Difference:
    """Root mean square and peak. position: of distances between centres, in distances from the nearest camera.
    colour, opacity: of values in [0, 1]. scale: of natural logarithms. unmatched: share of Gaussians that only one
    machine emits. render_psnr: of the context views, in dB, lowest of the views.
    """

    position_rms: float
    position_peak: float
    colour_rms: float
    colour_peak: float
    opacity_rms: float
    opacity_peak: float
    scale_rms: float
    scale_peak: float
    unmatched: float
    render_psnr: float

    @classmethod
    def largest(cls, found: Sequence["Difference"]) -> "Difference":
        """The worst of each."""
        worst = {field.name: max(getattr(one, field.name) for one in found) for field in fields(cls)}
        return cls(**(worst | {"render_psnr": min(one.render_psnr for one in found)}))

    def __str__(self) -> str:
        shown = {field.name: getattr(self, field.name) for field in fields(self)}
        return ", ".join(f"{name} {value:.2g}" for name, value in shown.items() if name != "render_psnr") + (
            f", render_psnr {self.render_psnr:.1f}"
        )


def tolerance(kind: str) -> dict[str, float]:
    """The bounds of FORMAT.md, section 15, by the names of `Difference`; kind: "full" or "reduced"."""
    text = (SPECIFICATION / "FORMAT.md").read_text().split("## 15.")[1].split("## 16.")[0]
    rows = re.findall(r"^\| `(\w+)` \| ([-.\de]+) \| ([-.\de]+) \|", text, re.MULTILINE)
    return {name: float({"full": full, "reduced": reduced}[kind]) for name, full, reduced in rows}


def beyond(found: Difference, kind: str) -> list[str]:
    """Names of what is outside the tolerance."""
    bounds = tolerance(kind)
    low = ["render_psnr"] if found.render_psnr < bounds["render_psnr"] else []
    return low + [name for name in bounds if name != "render_psnr" and getattr(found, name) > bounds[name]]


def difference(data: bytes, one: Float[Tensor, "n 14"], other: Float[Tensor, "m 14"]) -> Difference:
    """Of two machines' Gaussians of the stream `data`, one a row as `gaussian_samples.table` gives them."""
    return replace(without_rendering(data, one, other), render_psnr=_render_psnr(data, one, other))


def without_rendering(data: bytes, one: Float[Tensor, "n 14"], other: Float[Tensor, "m 14"]) -> Difference:
    """The same, where some Gaussians are not there to be rendered; its PSNR is infinite."""
    first, second = matched(data, one, other)
    depth = nearest_depth(data, first)
    position = (first[:, :3].double() - second[:, :3].double()).norm(dim=1) / depth
    colour = SH_DEGREE_0 * (first[:, 11:] - second[:, 11:]).abs()
    opacity = (first[:, 10] - second[:, 10]).abs()
    scale = (first[:, 3:6].log() - second[:, 3:6].log()).abs()
    parts = [statistic for values in (position, colour, opacity, scale) for statistic in (_rms(values), _peak(values))]
    unmatched = 1.0 - 2.0 * len(first) / (len(one) + len(other))
    return Difference(*parts, unmatched=unmatched, render_psnr=math.inf)


def matched(
    data: bytes, one: Float[Tensor, "n 14"], other: Float[Tensor, "m 14"]
) -> tuple[Float[Tensor, "k 14"], Float[Tensor, "k 14"]]:
    """The rows that stand for the same Gaussian. Both keep the order, and a few that are almost too faint are on one
    side only: each row of the shorter goes with the most alike of those around its place in the longer.
    """
    spare = abs(len(one) - len(other))
    if spare == 0:
        return one, other
    shorter, longer = (one, other) if len(one) < len(other) else (other, one)
    around = torch.arange(len(shorter))[:, None] + torch.arange(-spare, 2 * spare + 1)
    around = around.clamp(0, len(longer) - 1)
    unlike = longer[around] - shorter[:, None]
    unlike[..., :3] /= nearest_depth(data, shorter).float()[:, None, None]
    alike = unlike[..., [0, 1, 2, 10, 11, 12, 13]].norm(dim=2).argmin(dim=1, keepdim=True)
    chosen = longer[around.gather(1, alike)[:, 0]]
    return (shorter, chosen) if len(one) < len(other) else (chosen, shorter)


def _render_psnr(data: bytes, one: Tensor, other: Tensor) -> float:
    cameras, size = read_cameras(data)
    with torch.no_grad():
        images = [render(to_gaussians(rows), cameras, size).color.clamp(0, 1) for rows in (one, other)]
    return float(psnr(*images).min())


def to_gaussians(rows: Float[Tensor, "n 14"]) -> Gaussians:
    means, scales, rotations, opacities, harmonics = rows.split([3, 3, 4, 1, 3], dim=1)
    return Gaussians(means, scales, rotations, opacities[:, 0], harmonics[:, None])


def _rms(values: Tensor) -> float:
    return float(values.double().square().mean().sqrt())


def _peak(values: Tensor) -> float:
    return float(values.max())
