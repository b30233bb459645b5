"""The novel-view protocol: encode context views to bytes, decode the bytes, render at target views, compare."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.formats.evaluation_index import IndexEntry
from fecocodec.formats.scene_folder import read_views
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr, ssim
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.encode import Profile, encode_with


@dataclass(frozen=True)
class Score:
    """Quality of one coded scene; PSNR in dB and SSIM are means over views, num_bytes is the whole file."""

    name: str
    num_bytes: int
    num_gaussians: int
    target_psnr: float
    target_ssim: float
    context_psnr: float


def evaluate(
    profile: Profile,
    root: Path,
    entries: tuple[IndexEntry, ...],
    lambda_q: int,
    num_stages: int,
    size: tuple[int, int],
    refinement_steps: int | None = None,
) -> Iterator[Score]:
    """Scores of the entries one by one, every one from a stream of bytes that was written and read back.

    num_stages, refinement_steps: as `encode_with` takes them.
    """
    for entry in entries:
        views = read_views(root / entry.scene, views=(*entry.context, *entry.target), size=size)
        yield score(profile, entry.name, views, len(entry.context), lambda_q, num_stages, refinement_steps)


def score(
    profile: Profile,
    name: str,
    views: Views,
    num_context: int,
    lambda_q: int,
    num_stages: int,
    refinement_steps: int | None = None,
) -> Score:
    """Code the first `num_context` views, judge by all."""
    context = views.select(list(range(num_context)))
    data = encode_with(profile, context, lambda_q, num_stages, refinement_steps=refinement_steps)
    gaussians = decode_with(profile.receiver, data).gaussians
    rendered = render_views(gaussians, views)
    quality, structure = psnr(rendered, views.images), ssim(rendered, views.images)
    return Score(
        name=name,
        num_bytes=len(data),
        num_gaussians=gaussians.count,
        target_psnr=float(quality[num_context:].mean()),
        target_ssim=float(structure[num_context:].mean()),
        context_psnr=float(quality[:num_context].mean()),
    )


@torch.no_grad()
def render_views(gaussians: Gaussians, views: Views) -> Float[Tensor, "view 3 height width"]:
    """The Gaussians as the views' cameras see them, clamped to [0, 1]."""
    return render(gaussians, views.cameras, views.image_size).color.clamp(0.0, 1.0)
