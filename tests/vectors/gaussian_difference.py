"""Difference of the Gaussians that two machines decode from one stream, as defined in FORMAT.md, section 15."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from fecocodec.coding.camera_packing import unpack
from fecocodec.container import read_stream
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import render
from tests.rendering.brute_force import sh_basis
from tests.vectors.gaussian_samples import nearest_depth

SPECIFICATION = Path(__file__).resolve().parents[2] / "bitstream_spec"
MUCH_LESS_ALIKE = 4.0  # ratio of distances above which a row is a different Gaussian, despite rounding errors
UNKNOWN = 1 << 40  # no shift of indices
LEFT_OUT = 0.001  # share of Gaussians that may be on a threshold, such as the border of another view's image
MOST_FAINT = 16  # Gaussians that only one machine emits, in addition to the difference of the counts


@dataclass(frozen=True)
class Difference:
    """Root mean square and peak of differences.

    With R, the distance of the centre from the farthest camera in units of near, and at least 1: position is the
    distance between centres in units of near, divided by R^2; scale is the difference of natural logarithms, divided
    by R. colour: in the directions of the context cameras, in [0, 1]. opacity: in [0, 1]. Of colour and opacity,
    `LEFT_OUT` of the Gaussians, those with the greatest differences, are left out. unmatched: share of Gaussians that
    only one machine emits. render_psnr: in dB, minimum over the context views, with the centres of `one` in both.
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
        """Return the worst value of each measure."""
        worst = {field.name: max(getattr(one, field.name) for one in found) for field in fields(cls)}
        return cls(**(worst | {"render_psnr": min(one.render_psnr for one in found)}))

    def __str__(self) -> str:
        shown = {field.name: getattr(self, field.name) for field in fields(self)}
        return ", ".join(f"{name} {value:.2g}" for name, value in shown.items() if name != "render_psnr") + (
            f", render_psnr {self.render_psnr:.1f}"
        )


def tolerance(kind: str) -> dict[str, float]:
    """Return the tolerances of FORMAT.md, section 15, by the field names of `Difference`. kind: "full" or "reduced"."""
    text = (SPECIFICATION / "FORMAT.md").read_text().split("## 15.")[1].split("## 16.")[0]
    rows = re.findall(r"^\| `(\w+)` \| ([-.\de]+) \| ([-.\de]+) \|", text, re.MULTILINE)
    return {name: float({"full": full, "reduced": reduced}[kind]) for name, full, reduced in rows}


def beyond(found: Difference, kind: str) -> list[str]:
    """Return the names of the measures that exceed the tolerance."""
    bounds = tolerance(kind)
    low = ["render_psnr"] if found.render_psnr < bounds["render_psnr"] else []
    return low + [name for name in bounds if name != "render_psnr" and getattr(found, name) > bounds[name]]


def difference(data: bytes, one: Float[Tensor, "n field"], other: Float[Tensor, "m field"]) -> Difference:
    """Compare the Gaussians of two machines for the stream `data`, as tables of `gaussian_samples.table`."""
    return replace(without_rendering(data, one, other), render_psnr=_render_psnr(data, one, other))


def without_rendering(data: bytes, one: Float[Tensor, "n field"], other: Float[Tensor, "m field"]) -> Difference:
    """Compare subsets of Gaussians, without rendering; render_psnr is infinite."""
    first, second = matched(data, one, other)
    cameras = unpack(read_stream(data).cameras)
    near = cameras.near.double()
    reach = (torch.cdist(first[:, :3].double(), _centres(cameras)).amax(dim=1) / near).clamp_min(1.0)
    position = (first[:, :3].double() - second[:, :3].double()).norm(dim=1) / near / reach.square()
    colour = _without_largest((_colours(cameras, first) - _colours(cameras, second)).abs().flatten(1))
    opacity = _without_largest((first[:, 10:11] - second[:, 10:11]).abs())
    scale = (first[:, 3:6].log() - second[:, 3:6].log()).abs() / reach[:, None]
    named = {"position": position, "colour": colour, "opacity": opacity, "scale": scale}
    parts = {f"{name}_rms": _rms(values) for name, values in named.items()}
    parts |= {f"{name}_peak": _peak(values) for name, values in named.items()}
    unmatched = 1.0 - 2.0 * len(first) / (len(one) + len(other))
    return Difference(**parts, unmatched=unmatched, render_psnr=math.inf)


def matched(
    data: bytes, one: Float[Tensor, "n field"], other: Float[Tensor, "m field"]
) -> tuple[Float[Tensor, "k field"], Float[Tensor, "k field"]]:
    """Return the pairs of rows of the same Gaussian."""
    rows, rows_of_other = pairs(data, one, other)
    return one[rows], other[rows_of_other]


def pairs(
    data: bytes, one: Float[Tensor, "n field"], other: Float[Tensor, "m field"]
) -> tuple[Int[Tensor, " k"], Int[Tensor, " k"]]:
    """Return the indices of the rows of the same Gaussian: mutually most similar rows at about the same index.

    Both tables are in the same order, but indices shift, because Gaussians near the opacity threshold may be in one
    table only.
    """
    reach = abs(len(one) - len(other)) + MOST_FAINT
    in_other, in_one = _most_alike(data, one, other, reach), _most_alike(data, other, one, reach)
    rows = torch.arange(len(one))
    is_mutual = in_one[in_other] == rows
    shift = _shift_between(torch.where(is_mutual, in_other - rows, UNKNOWN))
    is_paired = shift != UNKNOWN
    return rows[is_paired], (rows + shift)[is_paired]


def _shift_between(shift: Int[Tensor, " n"]) -> Int[Tensor, " n"]:
    """Match the other rows with the shift of the matched rows before and after them, if these are equal."""
    rows = torch.arange(len(shift))
    is_known = shift != UNKNOWN
    above = torch.where(is_known, rows, -1).cummax(0).values.roll(1)
    below = torch.where(is_known, rows, len(shift)).flip(0).cummin(0).values.flip(0).roll(-1)
    above[0], below[-1] = -1, len(shift)
    before = torch.where(above >= 0, shift[above.clamp_min(0)], UNKNOWN)
    after = torch.where(below < len(shift), shift[below.clamp_max(len(shift) - 1)], UNKNOWN)
    before, after = torch.where(above < 0, after, before), torch.where(below >= len(shift), before, after)
    return torch.where(before == after, before, shift)


def _most_alike(
    data: bytes, rows: Float[Tensor, "n field"], among: Float[Tensor, "m field"], reach: int
) -> Int[Tensor, " n"]:
    """Return, for each row, the index of the most similar row, or of a closer one of comparable similarity."""
    offsets = torch.arange(-reach, reach + 1)
    offsets = offsets[offsets.abs().argsort(stable=True)]
    around = (torch.arange(len(rows))[:, None] + offsets).clamp(0, len(among) - 1)
    unlike = among[around] - rows[:, None]
    unlike[..., :3] /= nearest_depth(data, rows).float()[:, None, None]
    unlike = unlike[..., [0, 1, 2, 10, 11, 12, 13]].norm(dim=2)
    is_alike = unlike <= MUCH_LESS_ALIKE * unlike.amin(dim=1, keepdim=True)
    return around.gather(1, is_alike.int().argmax(dim=1, keepdim=True))[:, 0]


def _centres(cameras: Cameras) -> Float[Tensor, "view 3"]:
    return cameras.extrinsics[:, :3, 3].double()


def _colours(cameras: Cameras, rows: Float[Tensor, "n field"]) -> Float[Tensor, "n view 3"]:
    """Return the colour of each Gaussian in the direction of each context camera."""
    directions = normalize(rows[:, None, :3].double() - _centres(cameras), dim=-1)
    harmonics = rows[:, 11:].double().unflatten(1, (-1, 3))
    basis = sh_basis(directions.movedim(-1, 0))[: harmonics.shape[1]]
    return torch.einsum("knv,nkc->nvc", basis, harmonics)


def _without_largest(differences: Float[Tensor, "n value"]) -> Float[Tensor, "m value"]:
    """Leave out the Gaussians on thresholds: `LEFT_OUT` of them, those with the largest difference."""
    kept = len(differences) - int(LEFT_OUT * len(differences))
    return differences[differences.amax(dim=1).argsort()[:kept]]


def _render_psnr(data: bytes, one: Tensor, other: Tensor) -> float:
    """Compare renderings with the same centres: rounding decides the order of Gaussians at the same depth."""
    rows, rows_of_other = pairs(data, one, other)
    other = other.clone()
    other[rows_of_other, :3] = one[rows, :3]
    stream = read_stream(data)
    cameras, size = unpack(stream.cameras), (stream.header.height, stream.header.width)
    with torch.no_grad():
        images = [render(to_gaussians(rows), cameras, size).color.clamp(0, 1) for rows in (one, other)]
    return float(psnr(*images).min())


def to_gaussians(rows: Float[Tensor, "n field"]) -> Gaussians:
    means, scales, rotations, opacities, harmonics = rows.split([3, 3, 4, 1, rows.shape[1] - 11], dim=1)
    return Gaussians(means, scales, rotations, opacities[:, 0], harmonics.unflatten(1, (-1, 3)))


def _rms(values: Tensor) -> float:
    return float(values.double().square().mean().sqrt())


def _peak(values: Tensor) -> float:
    return float(values.max())
