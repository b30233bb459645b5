"""Rate control: targets of size and quality are kept closely in few encodings, unreachable ones are refused."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import OnProgress, decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.decoded_quality import decoded_quality, measure_decoded
from fecocodec.sender.encode import encode_with
from fecocodec.sender.lambda_search import AtLeastNewPsnr, AtLeastPsnr, AtMostKib, Target, target_note
from fecocodec.sender.optimisation_config import DEFAULT, FAST, OptimisationConfig
from fecocodec.sender.rate_control import NUM_FAST_ENCODINGS, NUM_FULL_ENCODINGS, Attempt, encode_to_target, search
from fecocodec.sender.view_quality import DecodedQuality
from tests.example_scenes import MODEL, example_views

CONFIG = DEFAULT.with_steps(1)
NAMES = ("left.jpg", "right.jpg")


class Curve:
    """A codec whose bytes and PSNR follow a curve of lambda, with the noise that optimisation adds."""

    def __init__(self, noise: float) -> None:
        self.noise, self.calls = noise, {FAST: 0, DEFAULT: 0}

    def __call__(self, lambda_q: int, config: OptimisationConfig, on_progress: OnProgress) -> Attempt:
        self.calls[config] += 1
        on_progress("coding stage 1", 0.1)
        on_progress("coding stage 2", 1.0)
        wiggle = self.noise * math.sin(1.7 * lambda_q)
        gain = 0.0 if config is FAST else 1.0
        num_bytes = 2000 * math.exp(2.8 - 0.0019 * lambda_q + 3e-7 * lambda_q**2 - 0.07 * gain + wiggle)
        psnr = 31.0 - 4e-6 * lambda_q**2 - 1e-3 * lambda_q + 1.2 * gain + 2.0 * wiggle
        return Attempt(lambda_q, bytes(round(num_bytes)), DecodedQuality((psnr + 1.0, psnr - 1.0)))


def quiet(_task: str, _fraction: float) -> None: ...


class CurveOfPairs(Curve):
    """Without optimisation, PSNR hardly grows below lambda 1e-3; with it, detail makes it grow on."""

    def __call__(self, lambda_q: int, config: OptimisationConfig, on_progress: OnProgress) -> Attempt:
        attempt = super().__call__(lambda_q, config, on_progress)
        psnr = 25.0 - 6e-7 * lambda_q**2 + (0.0 if config is FAST else 4.0 - 1.7e-3 * lambda_q)
        return replace(attempt, quality=DecodedQuality((psnr, psnr)))


@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize("kib", [3.0, 5.0, 8.0, 15.0, 25.0])
def test_a_size_is_hit_within_three_percent(kib: float, noise: float) -> None:
    curve = Curve(noise)
    found = search(curve, AtMostKib(kib), DEFAULT, DEFAULT.num_steps, NAMES, quiet)
    assert 0.97 * 1024 * kib <= len(found.data) <= 1024 * kib
    assert curve.calls[DEFAULT] <= NUM_FULL_ENCODINGS and curve.calls[FAST] <= NUM_FAST_ENCODINGS


@pytest.mark.parametrize(
    ("psnr", "curve_of", "noise"),
    [
        *((psnr, Curve, noise) for psnr in (20.0, 24.0, 27.0, 30.0) for noise in (0.0, 0.003)),
        *((psnr, CurveOfPairs, 0.003) for psnr in (24.5, 25.5, 26.5, 28.0)),  # which only detail reaches
    ],
)
def test_a_quality_is_reached_and_exceeded_by_little(psnr: float, curve_of: type[Curve], noise: float) -> None:
    curve = curve_of(noise)
    found = search(curve, AtLeastPsnr(psnr), DEFAULT, DEFAULT.num_steps, NAMES, quiet)
    assert psnr <= found.psnr <= psnr + 0.3
    assert curve.calls[DEFAULT] <= NUM_FULL_ENCODINGS


@pytest.mark.parametrize(("target", "lambda_q"), [(AtMostKib(1000.0), 0), (AtLeastPsnr(5.0), 1768)])
def test_a_target_that_every_lambda_reaches_gets_the_end_of_the_range(target: Target, lambda_q: int) -> None:
    assert search(Curve(0.0), target, DEFAULT, DEFAULT.num_steps, NAMES, quiet).lambda_q == lambda_q


@pytest.mark.parametrize(
    ("target", "sentence", "num_full"),
    [
        (
            AtMostKib(0.5),
            r"a file of 0\.5 KiB cannot be made, the smallest has about 2\.\d\d; raise the target, lower `sharp",
            0,  # no encoding in full is needed to know
        ),
        (AtMostKib(2.3), r"a file of 2\.3 KiB cannot be made, the smallest has 2\.66; raise", 1),
        (
            AtLeastPsnr(99.0),
            r"a PSNR of 99 dB cannot be reached, the best is 32.*limited by the detail.*`effort=best`, or leave out "
            r"the worst view, right\.jpg \(\d+\.\d\d dB\)",
            1,
        ),
    ],
)
def test_a_target_that_no_lambda_reaches_is_refused(target: Target, sentence: str, num_full: int) -> None:
    curve = Curve(0.0)
    with pytest.raises(InputError, match=sentence):
        search(curve, target, DEFAULT, DEFAULT.num_steps, (*NAMES, "third.jpg"), quiet)
    assert curve.calls[DEFAULT] == num_full


@pytest.mark.parametrize(
    ("target", "text"),
    [(AtMostKib(8.0), "8 KiB"), (AtLeastPsnr(28.5), "28.5 dB"), (AtLeastNewPsnr(24.0), "24 dB at new views")],
)
def test_the_target_is_named(target: Target, text: str) -> None:
    assert str(target) == text
    tasks = list[str]()
    search(Curve(0.0), target, DEFAULT, DEFAULT.num_steps, NAMES, lambda task, _fraction: tasks.append(task))
    assert tasks[0] == f"estimating lambda for {text}, try 1, coding stage 1"
    assert f"attempt 1 of up to 3 at {text}, coding stage 2" in tasks


@pytest.fixture(scope="module")
def views() -> Views:
    return example_views(2)


@pytest.fixture(scope="module")
def quality_of(codec: Codec, views: Views) -> Callable[[bytes], float]:
    def quality_of(data: bytes) -> float:
        with torch.no_grad():
            decoded = decode_with(codec.receiver, data)
            rendered = render(decoded.gaussians, decoded.cameras, views.image_size).color.clamp(0, 1)
            return float(-10 * (rendered - views.images).square().flatten(1).mean(dim=1).log10().mean())

    return quality_of


def test_files_keep_a_quality(
    codec: Codec, random_weights: Path, views: Views, quality_of: Callable[[bytes], float]
) -> None:
    best = encode_with(codec, views, quantise_lambda(1e-5), config=CONFIG)
    target = AtLeastPsnr(quality_of(best) - 1.0)
    chosen: list[float] = []
    found = encode_to_target(views, target, effort=CONFIG, model=random_weights / MODEL, on_lambda=chosen.append)
    assert found == encode_with(codec, views, quantise_lambda(chosen[0]), 2, CONFIG)
    assert quality_of(found) >= target.psnr


def test_a_target_that_every_lambda_meets_is_said_to_be_met() -> None:
    assert target_note(1e-5, AtMostKib(100000.0)) == (
        "the smallest lambda, 1e-05, already meets the target of 100000 KiB; no lambda makes a larger file."
    )
    for lmbda, target in ((2e-5, AtMostKib(8.0)), (1e-5, AtLeastPsnr(30.0))):
        assert target_note(lmbda, target) == f"lambda {lmbda:.3g} reaches the target of {target}."


def test_files_keep_a_quality_at_new_views(codec: Codec, random_weights: Path, views: Views) -> None:
    coded, checks = views.select([0]), views.select([1])

    def quality(data: bytes) -> float:
        return decoded_quality(codec.receiver, data, checks, checks.cameras).psnr

    best = quality(encode_with(codec, coded, quantise_lambda(1e-5), config=CONFIG))
    target = AtLeastNewPsnr(best - 1.0)
    found = encode_to_target(coded, target, effort=CONFIG, model=random_weights / MODEL, checks=checks)
    assert quality(found) >= target.psnr
    with pytest.raises(InputError, match=r"a PSNR of 99 dB at new views cannot be reached, the best is .*code more"):
        search(Curve(0.0), AtLeastNewPsnr(99.0), DEFAULT, DEFAULT.num_steps, ("check.jpg",), quiet)
    with pytest.raises(InputError, match="measured on photographs that are not coded; keep some as `checks`"):
        encode_to_target(coded, target, effort=CONFIG, model=random_weights / MODEL)


def test_quality_is_measured_after_each_stage_as_decoded(
    views: Views, codec: Codec, random_weights: Path, quality_of: Callable[[bytes], float]
) -> None:
    data = encode_with(codec, views, quantise_lambda(1e-4), config=FAST)
    first, last = measure_decoded(data, views, model=random_weights / MODEL)
    assert last.psnr == pytest.approx(quality_of(data), abs=1e-4)
    assert first.psnr != last.psnr
    assert last.psnr_of_view[last.worst_view] == min(last.psnr_of_view)
    with pytest.raises(InputError, match="holds 2 views of 64x64, but 1 of 64x64 are given"):
        measure_decoded(data, views.select([0]), model=random_weights / MODEL)


@pytest.mark.parametrize("num_steps", [0, 4])
def test_progress_covers_each_encoding(num_steps: int) -> None:
    """The steps within an encoding are reported too, so that the time left can be estimated within the first one."""
    reports: list[tuple[str, float]] = []
    target = AtMostKib(8.0)
    search(Curve(0.003), target, DEFAULT, num_steps, NAMES, lambda task, fraction: reports.append((task, fraction)))
    assert reports[0][0] == "estimating lambda for 8 KiB, try 1, coding stage 1"
    assert "attempt 1 of up to 3 at 8 KiB, coding stage 2" in [task for task, _ in reports]
    fractions = [fraction for _, fraction in reports]
    assert fractions == sorted(fractions) and fractions[0] > 0.0 and fractions[-1] <= 1.0
    first_of_full = next(fraction for task, fraction in reports if task.startswith("attempt 1"))
    assert first_of_full == pytest.approx({0: 3.1 / 6, 4: 3.3 / 12}[num_steps])


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0, -1.0])
def test_targets_that_no_file_can_have_are_refused(value: float) -> None:
    with pytest.raises(InputError, match=f"a target of {value} KiB cannot be reached; give a positive number"):
        AtMostKib(value)
    with pytest.raises(InputError, match=f"a target of {value} dB cannot be reached"):
        AtLeastPsnr(value)
