"""Rate control: find the lambda for a file size or a quality."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch

from fecocodec.checkpoint import model_folder
from fecocodec.container.lagrangian import LAMBDA_Q_MAX
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import OnProgress
from fecocodec.sender.distortion import mean_psnr
from fecocodec.sender.encode import assemble, check_views, code_stages, load_profile
from fecocodec.sender.steps import (
    MatchedViews,
    PreparedScene,
    Profile,
    match_views,
    prepare,
    stage_rendering,
)

MOST_ENCODINGS = 9  # of one search; each halves what is left of 1769 steps of lambda


@dataclass(frozen=True)
class AtMostKib:
    """The best quality in a file of at most so many KiB."""

    kib: float


@dataclass(frozen=True)
class AtLeastPsnr:
    """The smallest file whose decoded context views have this PSNR in dB."""

    psnr: float


Target = AtMostKib | AtLeastPsnr


@dataclass(frozen=True)
class _Encoded:
    """One encoding. psnr: of the decoded context views, in dB."""

    data: bytes
    psnr: float


def encode_to_target(
    views: Views,
    target: Target,
    *,
    refinement_steps: int | None = None,
    device: str = "cpu",
    model: Path | str | None = None,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Bytes of a `.fcs` stream of the size or quality that is asked for. refinement_steps: see `encode`.

    Raises InputError for views that cannot be coded and for a target that no lambda reaches, ModelError where weights
    are missing.
    """
    check_views(views, num_stages=2)
    return encode_to_target_with(
        load_profile(model_folder(model), device), views, target, on_progress, refinement_steps
    )


@torch.inference_mode(False)
@torch.no_grad()
def encode_to_target_with(
    profile: Profile,
    views: Views,
    target: Target,
    on_progress: OnProgress = lambda _task, _fraction: None,
    refinement_steps: int | None = None,
) -> bytes:
    """The same with networks that are loaded; a search matches the views once."""
    scene = prepare(profile, views)
    on_progress("matching views", 0.05)
    matched = match_views(profile, scene)
    encoder = partial(_encode, profile, scene, matched, refinement_steps)
    return _search(encoder, target, on_progress).data


def _encode(
    profile: Profile,
    scene: PreparedScene,
    matched: MatchedViews,
    refinement_steps: int | None,
    lambda_q: int,
) -> _Encoded:
    stages = code_stages(profile, scene, matched, lambda_q, 2, refinement_steps=refinement_steps)
    rendering = stage_rendering(profile, scene, stages[-1].after)
    return _Encoded(assemble(profile, scene, stages), mean_psnr(rendering.color, scene.images))


def _search(encoder: Callable[[int], _Encoded], target: AtMostKib | AtLeastPsnr, on_progress: OnProgress) -> _Encoded:
    """Halve the range of lambda_q: a larger one makes smaller files of less quality.

    Raises InputError where neither end of the range reaches the target.
    """
    reached: list[_Encoded] = []
    low, high = 0, LAMBDA_Q_MAX
    for number in range(MOST_ENCODINGS):
        lambda_q = (high if isinstance(target, AtMostKib) else low) if number == 0 else (low + high) // 2
        on_progress(f"coding, attempt {number + 1}", 0.1 + 0.9 * number / MOST_ENCODINGS)
        found = encoder(lambda_q)
        is_reached = _reaches(found, target)
        if number == 0 and not is_reached:
            raise InputError(_unreachable(found, target))
        if is_reached:
            reached.append(found)
        if number and is_reached == isinstance(target, AtMostKib):
            high = lambda_q
        elif number:
            low = lambda_q
        if _is_close(found, target) or high - low < 2:
            break
    return _best(reached, target)


def _best(reached: list[_Encoded], target: AtMostKib | AtLeastPsnr) -> _Encoded:
    """What was asked for is quality or bytes, not closeness to the target: neither falls strictly with lambda."""
    if isinstance(target, AtMostKib):
        return max(reached, key=lambda found: found.psnr)
    return min(reached, key=lambda found: len(found.data))


def _reaches(found: _Encoded, target: AtMostKib | AtLeastPsnr) -> bool:
    return _distance(found, target) >= 0.0


def _distance(found: _Encoded, target: AtMostKib | AtLeastPsnr) -> float:
    """How far inside the target: as a share of the bytes, or in dB; negative outside."""
    if isinstance(target, AtMostKib):
        return 1.0 - len(found.data) / (1024 * target.kib)
    return found.psnr - target.psnr


def _is_close(found: _Encoded, target: AtMostKib | AtLeastPsnr) -> bool:
    """Within 1% of the bytes, or 0.02 dB, and inside."""
    return 0.0 <= _distance(found, target) <= (0.01 if isinstance(target, AtMostKib) else 0.02)


def _unreachable(found: _Encoded, target: AtMostKib | AtLeastPsnr) -> str:
    if isinstance(target, AtMostKib):
        return (
            f"a file of {target.kib:g} KiB cannot be made, the smallest has {len(found.data) / 1024:.2f}; "
            "raise the target, or give fewer or smaller views."
        )
    return f"a PSNR of {target.psnr:g} dB cannot be reached, the best of these views is {found.psnr:.2f}; ask for less."
