"""The novel-view protocol: encode the context views, decode the bytes, render the target views, measure quality."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.evaluation.entries import open_scenes, without_guides
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.rendering.lpips import is_lpips_there, lpips_vgg
from fecocodec.rendering.metrics import psnr, ssim
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.rendering.rasterizer import render


@dataclass(frozen=True)
class Score:
    """Rate and quality of one coded scene. PSNR (dB) and other metrics are means over views. num_bytes: file size.

    target_lpips: with VGG16; None if its weights are not installed.
    """

    name: str
    num_bytes: int
    num_gaussians: int
    target_psnr: float
    target_ssim: float
    target_st_lpips: float
    target_lpips: float | None
    context_psnr: float


def evaluate(system: System, root: Path, entries: tuple[IndexEntry, ...], size: tuple[int, int]) -> Iterator[Score]:
    """Yield the score of each entry. root: folder with one folder per scene. size: (height, width) in pixels."""
    read = open_scenes(root, size)
    for entry in entries:
        views, guides = without_guides(read(entry), entry)
        yield score(system, entry.name, views, len(entry.context), guides)


def score(system: System, name: str, views: Views, num_context: int, guides: Views | None = None) -> Score:
    """Encode the first `num_context` views, and measure the quality of all views.

    guides: for systems that learn from photographs that are not coded.
    """
    result = system.run(views, num_context, guides)
    images = views.outside_masks(result.images)
    targets, photographs = images[num_context:], views.images[num_context:]
    quality, structure = psnr(images, views.images, views.ignored), ssim(images, views.images)
    return Score(
        name=name,
        num_bytes=result.num_bytes,
        num_gaussians=0 if result.gaussians is None else result.gaussians.count,
        target_psnr=float(quality[num_context:].mean()),
        target_ssim=float(structure[num_context:].mean()),
        target_st_lpips=float(st_lpips(targets, photographs).mean()),
        target_lpips=float(lpips_vgg(targets, photographs).mean()) if is_lpips_there("vgg16") else None,
        context_psnr=float(quality[:num_context].mean()),
    )


@torch.no_grad()
def render_views(gaussians: Gaussians, views: Views) -> Float[Tensor, "view 3 height width"]:
    """Render Gaussians at the cameras of the views: sRGB, clamped to [0, 1]."""
    return render(gaussians, views.cameras, views.image_size).color.clamp(0.0, 1.0)
