"""The stability suite: rules hold where they should, and a broken rule is a complaint."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch

from fecocodec.evaluation.stress import suite as stress
from fecocodec.evaluation.stress.box_room import Room, blank, painted, photograph, sideways, waves
from fecocodec.evaluation.stress.cases import Coded, Rule, StressCase, Trial, cases_of, format_cases_of, room_cases
from fecocodec.evaluation.stress.suite import StressSuite, run_suite
from fecocodec.evaluation.systems.image_compression import JPEG_XL, jpeg_xl_distance, pack_images
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.optimisation_config import FAST
from tests.example_scenes import MODEL

pytestmark = pytest.mark.usefixtures("found_once")
SCENE = "wall"


@pytest.fixture(scope="module")
def suite(random_weights: Path) -> Iterator[StressSuite]:
    """Without steps of optimisation, which no rule here is about."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stress, "encode_with", partial(encode_with, config=FAST))
        yield StressSuite(load_codec(random_weights / MODEL, "cpu"))


@pytest.fixture(scope="module")
def pair() -> Trial:
    return Trial(photograph(Room(painted), sideways(), (64, 64)), 2)


def case(pair: Trial, name: str) -> StressCase:
    cases = (*cases_of(pair, SCENE), *format_cases_of(pair, SCENE))
    (found,) = (case for case in cases if case.name == f"{SCENE}: {name}")
    return found


@pytest.mark.parametrize(
    "name", ["unit of length 1024 times smaller", "near beyond far", "mirrored axes", "baseline said to be 1%"]
)
def test_these_hold_even_untrained(suite: StressSuite, pair: Trial, name: str) -> None:
    verdict = suite.judge(case(pair, name))
    assert verdict.is_passed, verdict.complaint


def test_what_breaks_a_rule_is_a_complaint(suite: StressSuite, pair: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    darker = case(pair, "black")
    other = suite.judge(replace(darker, rule=Rule(has_same_bytes=True)))
    assert other.complaint == "the payloads differ from those of the reference" and not other.is_passed
    axes = case(pair, "mirrored axes")
    verdict = suite.judge(replace(axes, rule=Rule()))
    assert verdict.psnr is None and verdict.complaint.startswith("InputError:")
    monkeypatch.setattr(stress, "GENERATIONS", 2)
    monkeypatch.setattr(stress, "RULE_OF_GENERATIONS", Rule(most_lost=-99.0))
    verdict = suite.judge_generations(SCENE, pair)
    assert verdict.case == "wall: 2 generations" and verdict.complaint.endswith("dB are lost, at most -99 may be")


@pytest.mark.parametrize("num_bytes", [2000, 6000])
def test_photographs_of_the_baseline_have_equal_bytes(num_bytes: int) -> None:
    views = photograph(Room(painted), sideways(), (96, 96)).select([0, 1])
    size = sum(map(len, pack_images(views, JPEG_XL, jpeg_xl_distance(views, num_bytes))))
    assert size == pytest.approx(num_bytes, rel=0.03)


def test_losses_are_bounded() -> None:
    reference, found = Coded(b"", 25.0, ()), Coded(b"", 22.0, ("new views will be poor: this and that.",))
    for rule, ahead, complaint in (
        (Rule(3.0), -0.5, ""),
        (Rule(warning="will be poor"), 2.0, ""),
        (Rule(2.5), 0.0, "3.00 dB are lost, at most 2.5 may be"),
        (Rule(3.0), -0.6, "0.60 dB below JPEG XL at equal bytes, at most 0.5 may be"),
        (Rule(2.5, "will be poor"), 0.0, ""),
        (Rule(2.5, "too far"), 0.0, "3.00 dB are lost without a warning, at most 2.5 may be"),
        (Rule(is_refused=True), 0.0, "it was not refused"),
        (Rule(warning="is upside down"), 0.0, 'no warning says "is upside down"'),
    ):
        assert rule.complaint(found, reference, ahead) == complaint
    assert str(Rule(2.5, "too far")) == "warned or ≤2.5" and str(Rule(warning="is upside down")) == "warned"
    assert Rule(2.5).complaint(replace(found, psnr=float("nan")), reference, None).startswith("nan dB are lost")


def test_every_case_has_a_rule_that_can_fail(pair: Trial) -> None:
    cases = (*cases_of(pair, SCENE), *format_cases_of(pair, SCENE), *room_cases())
    assert [found.name for found in cases if str(found.rule) == "finite"] == []
    silent = [found.rule.most_lost for found in cases if not found.rule.warning]
    assert max(most for most in silent if most is not None) < 9.0


def test_known_verdicts_are_given_back(random_weights: Path, suite: StressSuite, pair: Trial) -> None:
    of_both = [found.name for scene in (SCENE, "floor") for found in cases_of(pair, scene)]
    names = [*of_both, *(found.name for found in (*format_cases_of(pair, SCENE), *room_cases()))]
    names.append(suite.name_of_generations(SCENE))
    known = {name: stress.Verdict(name, "finite") for name in names}
    codec = load_codec(random_weights / MODEL, "cpu")
    found = list(run_suite(codec, {SCENE: pair, "floor": pair}, 1e-3, known))
    assert [verdict for verdict, _ in found] == list(known.values()) and found[-1][1] == 1.0


def test_the_room_is_as_complex_as_it_is_asked_to_be() -> None:
    bare, simple, rich = (
        photograph(Room(paint), sideways(), (64, 64)).images
        for paint in (blank, lambda points: waves(points, 1), painted)
    )
    detail = [float((images[..., 1:] - images[..., :-1]).abs().mean()) for images in (bare, simple, rich)]
    assert detail == sorted(detail) and torch.all(bare[:, :, 30, 30] == bare[:, :, 31, 31])
