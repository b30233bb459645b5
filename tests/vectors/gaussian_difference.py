"""How far two machines' Gaussians of one stream are apart, in the terms of FORMAT.md, section 15."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.receiver.decode import read_cameras
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from tests.vectors.gaussian_samples import nearest_depth


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
    """The rows that stand for the same Gaussian: both keep the order, and few are on one side only."""
    if len(one) == len(other):
        return one, other
    longer, shorter = (one, other) if len(one) > len(other) else (other, one)
    depth = nearest_depth(data, longer)
    keep, at = [], 0
    for row in range(len(longer)):
        spare = len(longer) - row - (len(shorter) - at)
        is_same = at < len(shorter) and float((longer[row, :3] - shorter[at, :3]).norm()) < 0.02 * float(depth[row])
        if at < len(shorter) and (is_same or spare == 0):
            keep.append(row)
            at += 1
    chosen = longer[keep]
    return (chosen, shorter[: len(keep)]) if len(one) > len(other) else (shorter[: len(keep)], chosen)


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
