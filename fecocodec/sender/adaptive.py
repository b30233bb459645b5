"""Encoding that sends no more than a scene needs, at a given lambda, file size or quality."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch

from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.container import quantise_lambda
from fecocodec.container.lagrangian import LAMBDA_Q_MAX
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import OnProgress
from fecocodec.sender.distortion import mean_psnr
from fecocodec.sender.encode import assemble, check_views, code_stages, header_of, load_profile
from fecocodec.sender.refinement import patient_steps, suitable_steps
from fecocodec.sender.second_stage import choose_stages
from fecocodec.sender.steps import (
    CodedStage,
    MatchedViews,
    PreparedScene,
    Profile,
    match_views,
    prepare,
    stage_rendering,
)
from fecocodec.sender.unneeded import choose_keep

MOST_ENCODINGS = 9  # of one search; each halves what is left of 1769 steps of lambda


@dataclass(frozen=True)
class AtLambda:
    """Encode at this lambda, in [1e-5, 1e-2]."""

    lmbda: float


@dataclass(frozen=True)
class AtMostKib:
    """The best quality in a file of at most so many KiB."""

    kib: float


@dataclass(frozen=True)
class AtLeastPsnr:
    """The smallest file whose decoded context views have this PSNR in dB."""

    psnr: float


Goal = AtLambda | AtMostKib | AtLeastPsnr


@dataclass(frozen=True)
class _Encoded:
    """stages: what was chosen to be sent. data: the stream of them, without a keep section. psnr: of the context."""

    stages: tuple[CodedStage, ...]
    data: bytes
    psnr: float


def encode_adaptively(
    views: Views,
    goal: Goal,
    *,
    refinement_steps: int | None = None,
    device: str = "cpu",
    model: str = DEFAULT_MODEL,
    weights: str | Path = SHIPPED,
    on_progress: OnProgress = lambda _task, _fraction: None,
) -> bytes:
    """Bytes of a `.fcs` stream that has a second stage only where that pays, and whose receiver emits only Gaussians
    that some pixel needs. refinement_steps: of the last stage's latents, see `encode`; None: sixteen, or what suits the
    size; where lambda is searched for, the few that `encode` takes.

    Raises InputError for views that cannot be coded and for a goal that no lambda reaches, ModelError where weights are
    missing.
    """
    check_views(views, num_stages=2)
    if isinstance(goal, AtLambda):
        quantise_lambda(goal.lmbda)
    return encode_adaptively_with(
        load_profile(Path(weights) / model, device), views, goal, on_progress, refinement_steps
    )


@torch.inference_mode(False)
@torch.no_grad()
def encode_adaptively_with(
    profile: Profile,
    views: Views,
    goal: Goal,
    on_progress: OnProgress = lambda _task, _fraction: None,
    refinement_steps: int | None = None,
) -> bytes:
    """The same with networks that are loaded; a search matches the views once."""
    scene = prepare(profile, views)
    on_progress("matching views", 0.05)
    matched = match_views(profile, scene)
    encoder = partial(_encode, profile, scene, matched)
    if isinstance(goal, AtLambda):
        on_progress("coding", 0.5)
        lambda_q = quantise_lambda(goal.lmbda)
        found = encoder(refinement_steps, lambda_q)
        if refinement_steps is None:
            found = _refined_patiently(profile, scene, matched, found, lambda_q)
    else:
        found = _search(partial(encoder, refinement_steps), goal, on_progress)
    on_progress("choosing Gaussians", 0.9)
    data = _with_keep(profile, scene, found)
    is_too_large = isinstance(goal, AtMostKib) and len(data) > 1024 * goal.kib
    return found.data if is_too_large else data


def _encode(
    profile: Profile,
    scene: PreparedScene,
    matched: MatchedViews,
    refinement_steps: int | None,
    lambda_q: int,
) -> _Encoded:
    chosen = choose_stages(profile, scene, matched, lambda_q, refinement_steps)
    data = assemble(profile, scene, chosen.stages)
    return _Encoded(chosen.stages, data, mean_psnr(chosen.renderings, scene.images))


def _refined_patiently(
    profile: Profile, scene: PreparedScene, matched: MatchedViews, found: _Encoded, lambda_q: int
) -> _Encoded:
    """As many stages, in more steps. How many stages pay is told by few steps: many make a single stage look as good as
    two where the photographs were taken, and it is not so good between them (docs/experiments.md)."""
    steps = patient_steps(scene, lambda_q)
    if steps == suitable_steps(scene, lambda_q):
        return found
    stages = code_stages(profile, scene, matched, lambda_q, len(found.stages), refinement_steps=steps)
    renderings = stage_rendering(profile, scene, stages[-1].after).color
    return _Encoded(stages, assemble(profile, scene, stages), mean_psnr(renderings, scene.images))


def _with_keep(profile: Profile, scene: PreparedScene, found: _Encoded) -> bytes:
    """The stream that also says which Gaussians to emit, where that is worth it."""
    header = header_of(profile, scene, found.stages)
    keep = choose_keep(profile, scene, found.stages, header, len(found.data))
    return found.data if keep is None else assemble(profile, scene, found.stages, keep)


def _search(encoder: Callable[[int], _Encoded], goal: AtMostKib | AtLeastPsnr, on_progress: OnProgress) -> _Encoded:
    """Halve the range of lambda_q: a larger one makes smaller files of less quality.

    Raises InputError where neither end of the range reaches the goal.
    """
    reached: list[_Encoded] = []
    low, high = 0, LAMBDA_Q_MAX
    for number in range(MOST_ENCODINGS):
        lambda_q = (high if isinstance(goal, AtMostKib) else low) if number == 0 else (low + high) // 2
        on_progress(f"coding, attempt {number + 1}", 0.1 + 0.9 * number / MOST_ENCODINGS)
        found = encoder(lambda_q)
        is_reached = _reaches(found, goal)
        if number == 0 and not is_reached:
            raise InputError(_unreachable(found, goal))
        if is_reached:
            reached.append(found)
        if number and is_reached == isinstance(goal, AtMostKib):
            high = lambda_q
        elif number:
            low = lambda_q
        if _is_close(found, goal) or high - low < 2:
            break
    return _best(reached, goal)


def _best(reached: list[_Encoded], goal: AtMostKib | AtLeastPsnr) -> _Encoded:
    """What was asked for is quality or bytes, not closeness to the goal: neither falls strictly with lambda."""
    if isinstance(goal, AtMostKib):
        return max(reached, key=lambda found: found.psnr)
    return min(reached, key=lambda found: len(found.data))


def _reaches(found: _Encoded, goal: AtMostKib | AtLeastPsnr) -> bool:
    return _distance(found, goal) >= 0.0


def _distance(found: _Encoded, goal: AtMostKib | AtLeastPsnr) -> float:
    """How far inside the goal: as a share of the bytes, or in dB; negative outside."""
    if isinstance(goal, AtMostKib):
        return 1.0 - len(found.data) / (1024 * goal.kib)
    return found.psnr - goal.psnr


def _is_close(found: _Encoded, goal: AtMostKib | AtLeastPsnr) -> bool:
    """Within 1% of the bytes, or 0.02 dB, and inside."""
    return 0.0 <= _distance(found, goal) <= (0.01 if isinstance(goal, AtMostKib) else 0.02)


def _unreachable(found: _Encoded, goal: AtMostKib | AtLeastPsnr) -> str:
    if isinstance(goal, AtMostKib):
        return (
            f"a file of {goal.kib:g} KiB cannot be made, the smallest of these views has {len(found.data) / 1024:.2f}; "
            "ask for more, give fewer or smaller views, or refine by more steps."
        )
    return f"a PSNR of {goal.psnr:g} dB cannot be reached, the best of these views is {found.psnr:.2f}; ask for less."
