"""The stability suite: rules hold where they should, and a broken rule is a complaint."""

from pathlib import Path

import pytest
import torch

from fecocodec.evaluation.stress import suite as stress
from fecocodec.evaluation.stress.box_room import Room, blank, painted, photograph, sideways, waves
from fecocodec.evaluation.stress.cases import StressCase, Trial, cases_of, room_cases
from fecocodec.evaluation.stress.suite import StressSuite, run_suite
from fecocodec.sender.codec import load_codec
from tests.example_scenes import MODEL

SCENE = "wall"


@pytest.fixture(scope="module")
def suite(random_weights: Path) -> StressSuite:
    return StressSuite(load_codec(random_weights / MODEL, "cpu"))


@pytest.fixture(scope="module")
def pair() -> Trial:
    return Trial(photograph(Room(painted), sideways(), (64, 64)), 2)


def case(pair: Trial, name: str) -> StressCase:
    (found,) = (case for case in cases_of(pair, SCENE) if case.name == f"{SCENE}: {name}")
    return found


@pytest.mark.parametrize(
    "name", ["unit of length 1024 times smaller", "near beyond far", "mirrored axes", "baseline said to be 1%"]
)
def test_these_hold_even_untrained(suite: StressSuite, pair: Trial, name: str) -> None:
    verdict = suite.judge(case(pair, name))
    assert verdict.is_passed, verdict.complaint


def test_a_broken_rule_is_a_complaint(suite: StressSuite, pair: Trial) -> None:
    units = case(pair, "unit of length 1024 times smaller")
    not_refused = suite.judge(StressCase(units.name, units.trial, units.reference, "refused"))
    assert not_refused.complaint == "it was not refused" and not not_refused.is_passed
    silent = suite.judge(StressCase(units.name, units.trial, units.reference, "warned"))
    assert silent.complaint == "the sender gave no warning"
    darker = case(pair, "black")
    other = suite.judge(StressCase(darker.name, darker.trial, darker.reference, "same bytes"))
    assert other.complaint == "the payloads differ from those of the reference"


def test_a_refusal_where_none_belongs_is_a_complaint(suite: StressSuite, pair: Trial) -> None:
    axes = case(pair, "mirrored axes")
    verdict = suite.judge(StressCase(axes.name, axes.trial, axes.reference, "finite"))
    assert verdict.psnr is None and verdict.complaint.startswith("InputError:")


def test_generations_are_judged(suite: StressSuite, pair: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stress, "GENERATIONS", 2)
    monkeypatch.setattr(stress, "LARGEST_GENERATION_LOSS_DB", -99.0)
    verdict = suite.judge_generations(SCENE, pair)
    assert verdict.case == "wall: 2 generations" and "dB lost in 2 generations" in verdict.complaint


def test_known_verdicts_are_given_back(random_weights: Path, suite: StressSuite, pair: Trial) -> None:
    names = [found.name for found in (*cases_of(pair, SCENE), *room_cases())] + [suite.name_of_generations(SCENE)]
    known = {name: stress.Verdict(name, "finite", None, None, None, None, None, 0, "") for name in names}
    codec = load_codec(random_weights / MODEL, "cpu")
    found = list(run_suite(codec, {SCENE: pair}, 1e-3, known))
    assert [verdict for verdict, _ in found] == list(known.values()) and found[-1][1] == 1.0


def test_the_room_is_as_complex_as_it_is_asked_to_be() -> None:
    bare, simple, rich = (
        photograph(Room(paint), sideways(), (64, 64)).images
        for paint in (blank, lambda points: waves(points, 1), painted)
    )
    detail = [float((images[..., 1:] - images[..., :-1]).abs().mean()) for images in (bare, simple, rich)]
    assert detail == sorted(detail) and torch.all(bare[:, :, 30, 30] == bare[:, :, 31, 31])
