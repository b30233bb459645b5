"""Rate control: choose lambda for a target file size or a target quality.

File size and PSNR decrease with lambda in practice. A few fast encodings without optimisation locate the target on the
rate-distortion curve; a few full encodings then correct the remaining difference by the secant method.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fecocodec.checkpoint import model_folder
from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX, dequantise_lambda
from fecocodec.errors import InputError, SizeError
from fecocodec.geometry.views import Views
from fecocodec.progress import OnProgress, Progress, ignore_progress
from fecocodec.sender.codec import load_codec
from fecocodec.sender.decoded_quality import decoded_quality
from fecocodec.sender.encode import OnOmission, OnWarning, matched_scene, write_scene
from fecocodec.sender.lambda_roles import decades_below
from fecocodec.sender.lambda_search import AtLeastNewPsnr, AtMostKib, Point, Target, next_lambda_q, point_of
from fecocodec.sender.optimisation_config import BEST, FAST, OptimisationConfig, config_of_effort
from fecocodec.sender.view_checks import check_views
from fecocodec.sender.view_quality import DecodedQuality

FIRST_LAMBDA_Q = 1179  # lambda 1e-3
NUM_FAST_ENCODINGS, NUM_FULL_ENCODINGS = 3, 3
NEARBY_LAMBDA_Q = 64  # the curve is nearly linear over this distance, so the fast search ends
# Gain of the default number of optimisation steps at equal lambda, on training scenes: ln(bytes), dB at lambda 1e-2,
# and further dB for each power of ten below it, where files get detail.
SIZE_GAIN, PSNR_GAIN, PSNR_GAIN_BELOW = 0.13, 0.9, 0.85
OUT_OF_REACH = 0.35  # ln(bytes) by which the smallest file must be expected to exceed a target that is given up at once
TIME_OF_STEP = 0.5  # time that an optimisation step adds to an encoding, relative to one without optimisation


@dataclass(frozen=True)
class Attempt:
    """One encoding. data: the stream. quality: decoded from it, of the photographs that the target is about."""

    lambda_q: int
    data: bytes
    quality: DecodedQuality

    @property
    def psnr(self) -> float:
        return self.quality.psnr


Encoder = Callable[[int, OptimisationConfig, OnProgress], Attempt]
OnLambda = Callable[[float], None]


@torch.inference_mode(False)
@torch.no_grad()
def encode_to_target(
    views: Views,
    target: Target,
    *,
    guides: Views | None = None,
    checks: Views | None = None,
    effort: str | OptimisationConfig = "default",
    sharpness: float = 0.0,
    device: str = "cpu",
    model: Path | str | None = None,
    on_progress: OnProgress = ignore_progress,
    on_warning: OnWarning = lambda _sentence: None,
    on_omission: OnOmission | None = None,
    on_lambda: OnLambda = lambda _lambda: None,
) -> bytes:
    """Encode views to the bytes of a `.fcs` stream that meets a target. Matching runs once for all encodings.

    target: `AtMostKib`, `AtLeastPsnr` or `AtLeastNewPsnr`. checks: photographs that the last of them is about, with
    cameras in the world frame of the views. on_lambda: called with the lambda that is chosen. Other arguments as for
    `encode`. Raises InputError for views that cannot be encoded and for a target that no lambda reaches, ModelError if
    weights cannot be loaded.
    """
    check_views(views, 2, guides)
    config, codec = config_of_effort(effort, sharpness), load_codec(model_folder(model), device)
    is_about_new = isinstance(target, AtLeastNewPsnr)
    if is_about_new and checks is None:
        raise InputError("a PSNR of new views is measured on photographs that are not coded; keep some as `checks`.")
    measured, cameras = (checks, checks.cameras) if is_about_new and checks else (views, None)
    on_progress("matching views", 0.0)
    encoder, scene = matched_scene(codec, views, guides, on_warning, on_omission)

    def attempt(lambda_q: int, config: OptimisationConfig, on_progress: OnProgress) -> Attempt:
        data = write_scene(encoder, scene, lambda_q, 2, config, on_progress)
        return Attempt(lambda_q, data, decoded_quality(codec.receiver, data, measured, cameras))

    num_steps = config.steps_of_last(encoder.num_pixels, FIRST_LAMBDA_Q)
    best = search(attempt, target, config, num_steps, measured.names, on_progress)
    on_lambda(dequantise_lambda(best.lambda_q))
    return best.data


def search(
    encoder: Encoder,
    target: Target,
    config: OptimisationConfig,
    num_steps: int,
    names: tuple[str, ...],
    on_progress: OnProgress,
) -> Attempt:
    """Return the best of a few encodings that reach the target.

    num_steps: optimisation steps of the last stage, at lambda 1e-3. names: of what is measured, for messages.
    on_progress: its fraction assumes NUM_FULL_ENCODINGS, so the work may end earlier.
    Raises InputError if no lambda reaches the target.
    """
    fast: list[Point] = []
    lambda_q = FIRST_LAMBDA_Q
    for number in range(NUM_FAST_ENCODINGS):
        report = _reporter(on_progress, f"estimating lambda for {target}, try {number + 1}", number, num_steps)
        fast.append(_expected(_point(encoder(lambda_q, FAST, report), target), target, num_steps))
        lambda_q = next_lambda_q(fast)
        if any(abs(point.lambda_q - lambda_q) <= NEARBY_LAMBDA_Q for point in fast):
            break
    smallest = max(fast, key=lambda point: point.lambda_q)
    if isinstance(target, AtMostKib) and smallest.lambda_q == LAMBDA_Q_MAX and smallest.margin < -OUT_OF_REACH:
        raise _too_small(target, target.kib * math.exp(-smallest.margin), config, "about ")
    full: list[Attempt] = []
    while not _is_done(full, target):
        _require_reachable(full, target, config, names)
        number = len(full)
        of_most = f" of up to {NUM_FULL_ENCODINGS}" if number < NUM_FULL_ENCODINGS else ""
        task = f"attempt {number + 1}{of_most} at {target}"
        report = _reporter(on_progress, task, NUM_FAST_ENCODINGS + number, num_steps)
        full.append(encoder(lambda_q, config, report))
        lambda_q = next_lambda_q(fast, [_point(attempt, target) for attempt in full])
    return _best(full, target)


def _reporter(on_progress: OnProgress, task: str, number: int, num_steps: int) -> OnProgress:
    """Return the callback of one encoding. number: from 0, fast ones first; each beyond the usual ones is the last."""
    num_full = max(NUM_FULL_ENCODINGS, number + 1 - NUM_FAST_ENCODINGS)
    times = [1.0] * NUM_FAST_ENCODINGS + [1.0 + TIME_OF_STEP * num_steps] * num_full
    part = Progress(on_progress).split(*times)[number]
    return lambda step, fraction: part(f"{task}, {step}", fraction)


def _is_done(full: Sequence[Attempt], target: Target) -> bool:
    """Return whether an attempt is within the tolerance, or one reaches the target and no better one is left."""
    points = [_point(attempt, target) for attempt in full]
    reached = [point for point in points if point.margin >= 0.0]
    if any(point.is_inside for point in points) or (reached and len(full) >= NUM_FULL_ENCODINGS):
        return True
    unfavourable_end = LAMBDA_Q_MAX - _favourable_end(target)
    return any(point.lambda_q == unfavourable_end for point in reached)


def _require_reachable(
    full: Sequence[Attempt], target: Target, config: OptimisationConfig, names: tuple[str, ...]
) -> None:
    """Raise InputError if the attempt at the favourable end of the lambda range misses the target, as all do then."""
    at_end = [attempt for attempt in full if attempt.lambda_q == _favourable_end(target)]
    if at_end and all(_point(attempt, target).margin < 0.0 for attempt in full):
        raise _unreachable(at_end[-1], target, config, names)


def _favourable_end(target: Target) -> int:
    """Return the quantised lambda of the smallest file, or of the best quality."""
    return LAMBDA_Q_MAX if isinstance(target, AtMostKib) else 0


def _best(full: Sequence[Attempt], target: Target) -> Attempt:
    """Return the attempt with the best PSNR, or the fewest bytes, among those that reach the target."""
    reached = [attempt for attempt in full if _point(attempt, target).margin >= 0.0]
    if isinstance(target, AtMostKib):
        return max(reached, key=lambda attempt: attempt.psnr)
    return min(reached, key=lambda attempt: len(attempt.data))


def _point(attempt: Attempt, target: Target) -> Point:
    return point_of(attempt.lambda_q, len(attempt.data), attempt.psnr, target)


def _expected(fast: Point, target: Target, num_steps: int) -> Point:
    """Return the expected point of the full encoding at the lambda of this fast encoding."""
    if num_steps == 0:
        return fast
    if isinstance(target, AtMostKib):
        return replace(fast, margin=fast.margin + SIZE_GAIN)
    return replace(fast, margin=fast.margin + PSNR_GAIN + PSNR_GAIN_BELOW * decades_below(LAMBDA_Q_MAX, fast.lambda_q))


def _unreachable(attempt: Attempt, target: Target, config: OptimisationConfig, names: tuple[str, ...]) -> InputError:
    """Return the error for a target that `attempt`, at the favourable end of the lambda range, misses."""
    if isinstance(target, AtMostKib):
        return _too_small(target, len(attempt.data) / 1024, config)
    if isinstance(target, AtLeastNewPsnr):
        return InputError(
            f"a PSNR of {target.psnr:g} dB at new views cannot be reached, the best is {attempt.psnr:.2f}: a larger "
            "file does not show what no coded view shows; lower the target, or code more photographs by `views`."
        )
    worst = attempt.quality.worst_view
    advice = ["lower the target"]
    if config.num_steps < BEST.num_steps:
        advice.append("use `effort=best`")
    if len(names) > 2:
        advice.append(f"leave out the worst view, {names[worst]} ({attempt.quality.psnr_of_view[worst]:.2f} dB)")
    return InputError(
        f"a PSNR of {target.psnr:g} dB cannot be reached, the best is {attempt.psnr:.2f}: even the smallest lambda, "
        "with the largest file, is limited by the detail that the networks represent and by how well the views "
        f"agree; {', or '.join(advice)}."
    )


def _too_small(target: AtMostKib, kib: float, config: OptimisationConfig, about: str = "") -> SizeError:
    """Return the error for a target below the smallest file, which has `kib`. about: before a size that is expected."""
    lower = ", lower `sharpness`" if config.num_steps > 0 and config.sharpness > -1.0 else ""
    return SizeError(
        f"a file of {target.kib:g} KiB cannot be made, the smallest has {about}{kib:.2f}; raise the target{lower}, or "
        "give fewer `views`, or a smaller `size`.",
        kib,
    )
