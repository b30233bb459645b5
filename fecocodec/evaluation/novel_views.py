"""The novel-view protocol: encode context views to bytes, decode the bytes, render at target views, compare."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.formats.evaluation_index import IndexEntry
from fecocodec.formats.scene_folder import read_views
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.rendering.metrics import psnr, ssim
from fecocodec.rendering.rasterizer import render


@dataclass(frozen=True)
class Score:
    """Quality of one coded scene; PSNR in dB and SSIM are means over views, num_bytes is the whole file."""

    name: str
    num_bytes: int
    num_gaussians: int
    target_psnr: float
    target_ssim: float
    context_psnr: float


def evaluate(system: System, root: Path, entries: tuple[IndexEntry, ...], size: tuple[int, int]) -> Iterator[Score]:
    """Scores of the entries one by one. root: folder of scene folders. size: (height, width)."""
    for entry in entries:
        views = read_views(root / entry.scene, views=(*entry.context, *entry.target), size=size, background="white")
        yield score(system, entry.name, views, len(entry.context))


def score(system: System, name: str, views: Views, num_context: int) -> Score:
    """Code the first `num_context` views, compare all."""
    found = system.reconstruct(views, num_context)
    quality, structure = psnr(found.images, views.images), ssim(found.images, views.images)
    return Score(
        name=name,
        num_bytes=found.num_bytes,
        num_gaussians=0 if found.gaussians is None else found.gaussians.count,
        target_psnr=float(quality[num_context:].mean()),
        target_ssim=float(structure[num_context:].mean()),
        context_psnr=float(quality[:num_context].mean()),
    )


@torch.no_grad()
def render_views(gaussians: Gaussians, views: Views) -> Float[Tensor, "view 3 height width"]:
    """Render Gaussians at the views' cameras, clamped to [0, 1]."""
    return render(gaussians, views.cameras, views.image_size).color.clamp(0.0, 1.0)
