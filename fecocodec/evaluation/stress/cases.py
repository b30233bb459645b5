"""The stress cases: how each is derived from a reference scene, and the rule that its result must satisfy."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from fecocodec.container import read_stream
from fecocodec.evaluation.stress import perturbations
from fecocodec.evaluation.stress.box_room import (
    Room,
    along_a_line,
    back_to_back,
    blank,
    chequered,
    facing,
    forwards,
    orbit,
    painted,
    photograph,
    sideways,
    turning,
    with_far_view,
)
from fecocodec.geometry.views import Views

MOST_BEHIND_DB = 0.5


@dataclass(frozen=True)
class Coded:
    """A coded trial. psnr: of the target views, in dB. warnings: what the sender says about its input and its file."""

    data: bytes
    psnr: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Rule:
    """Pass criterion of a stress case; an empty rule asks for finite values alone, as every rule does.

    most_lost: largest loss of PSNR against the reference, in dB; negative for cases that are easier. warning: regular
    expression of a warning that must come; with `most_lost`, if more is lost. is_refused: the sender raises InputError.
    has_same_bytes: the payloads equal those of the reference.
    """

    most_lost: float | None = None
    warning: str = ""
    is_refused: bool = False
    has_same_bytes: bool = False

    def __str__(self) -> str:
        if self.is_refused:
            return "refused"
        limit = "" if self.most_lost is None else f"≤{self.most_lost:g}"
        parts = filter(None, ("warned" * bool(self.warning), limit, "same bytes" * self.has_same_bytes))
        return (" or " if self.warning else ", ").join(parts) or "finite"

    def complaint(self, found: Coded, reference: Coded, ahead: float | None) -> str:
        """Return how the rule is violated, or an empty string. ahead: PSNR above that of JPEG XL at equal bytes, dB."""
        lost = reference.psnr - found.psnr
        if self.is_refused:
            return "it was not refused"
        is_warned = bool(self.warning) and any(re.search(self.warning, sentence) for sentence in found.warnings)
        if self.warning and self.most_lost is None and not is_warned:
            return f'no warning says "{self.warning}"'
        if self.has_same_bytes and read_stream(found.data).payloads != read_stream(reference.data).payloads:
            return "the payloads differ from those of the reference"
        if self.most_lost is not None and not lost <= self.most_lost and not is_warned:
            silently = " without a warning" if self.warning else ""
            return f"{lost:.2f} dB are lost{silently}, at most {self.most_lost:g} may be"
        if ahead is not None and ahead < -MOST_BEHIND_DB:
            return f"{-ahead:.2f} dB below JPEG XL at equal bytes, at most {MOST_BEHIND_DB:g} may be"
        return ""


CASE_SIZE = (192, 192)  # (height, width) of the photographs and of the room, in pixels


@dataclass(frozen=True)
class Trial:
    """Input of one trial. views: context views, then target views."""

    views: Views
    num_context: int


@dataclass(frozen=True)
class StressCase:
    """One stress case. trial: creates its trial. reference: creates the reference trial of the same scene."""

    name: str
    trial: Callable[[], Trial]
    reference: Callable[[], Trial]
    rule: Rule


Made = tuple[str, Callable[[], Views], Rule]
REFUSED = Rule(is_refused=True)
APART, POOR = "almost at one position", "poor"


def _lost(most: float) -> Rule:
    return Rule(most_lost=most)


def _warned(sentence: str) -> Rule:
    return Rule(warning=sentence)


def cases_of(pair: Trial, name: str) -> tuple[StressCase, ...]:
    """Return the cases of two context views whose photographs or cameras are wrong. name: prefix of their names."""
    views, two = pair.views, pair.num_context
    made: list[Made] = [
        ("reference", lambda: views, _lost(0.0)),
        ("night with noise", lambda: _exposed(views, 0.02, noise=0.03), _lost(0.0)),
        ("black", lambda: _exposed(views, 1e-5), _warned("almost black")),
        ("overexposed", lambda: _exposed(views, 4.0), _lost(6.0)),
        ("exposure differs 4:1", lambda: perturbations.exposed(views, (2, 2, 2), (0.5, 0.5, 0.5)), _lost(1.5)),
        ("white balance differs", lambda: perturbations.exposed(views, (1.3, 1, 0.8), (0.8, 1, 1.3)), _lost(0.5)),
        ("motion blur of 9 pixels", lambda: perturbations.blurred(views, 9, two), _lost(3.5)),
        ("noise of 5%", lambda: _exposed(views, 1.0, noise=0.05), _lost(6.5)),
        ("poses turned by 0.1 degrees", lambda: perturbations.turned(views, 0.1, two), _lost(0.5)),
        ("poses turned by 1 degree", lambda: perturbations.turned(views, 1.0, two), _lost(0.5)),
        ("poses turned by 5 degrees", lambda: perturbations.turned(views, 5.0, two), _lost(0.5)),
        ("poses moved by 1% of baseline", lambda: perturbations.moved(views, 0.01, two), _lost(0.5)),
        ("poses moved by 20% of baseline", lambda: perturbations.moved(views, 0.2, two), _lost(5.5)),
        ("baseline said to be 1%", lambda: perturbations.closer_together(views, 0.01, two), _lost(0.5)),
        ("baseline said to be 10 times", lambda: perturbations.closer_together(views, 10.0, two), _lost(0.5)),
        ("focal length 20% wrong", lambda: perturbations.with_focal(views, 1.2), _lost(1.0)),
        ("OpenGL axes", lambda: perturbations.with_axes(views, (1.0, -1.0, -1.0)), _warned("axes reversed")),
        ("mirrored axes", lambda: perturbations.with_axes(views, (-1.0, 1.0, 1.0)), REFUSED),
        ("depth bounds 10 times too wide", lambda: perturbations.with_bounds(views, 0.1, 10.0), _lost(1.0)),
        ("depth bounds 1000 times too wide", lambda: perturbations.with_bounds(views, 1e-3, 1e3), _lost(1.0)),
        ("depth bounds beyond the scene", lambda: perturbations.with_bounds(views, 20.0, 20.0), _lost(0.5)),
        ("depth bounds before the scene", lambda: perturbations.with_bounds(views, 0.02, 0.02), _lost(0.5)),
        ("near beyond far", lambda: perturbations.with_bounds(views, 1000.0, 1.0), REFUSED),
    ]
    return _cases(made, pair, name)


def format_cases_of(pair: Trial, name: str) -> tuple[StressCase, ...]:
    """Return the cases of the same photographs at other sizes, in other units, in another order or number."""
    views, two = pair.views, pair.num_context
    made: list[Made] = [
        (
            "unit of length 1024 times smaller",
            lambda: perturbations.in_other_units(views, 1024.0),
            Rule(0.05, has_same_bytes=True),
        ),
        ("unit of length 1000 times larger", lambda: perturbations.in_other_units(views, 1e-3), _lost(0.05)),
        ("order of views swapped", lambda: views.select([1, 0, *range(2, len(views.images))]), _lost(0.5)),
        ("64x64 pixels", lambda: perturbations.resized(views, 64, 64), _lost(3.0)),
        ("odd size 251x187", lambda: perturbations.resized(views, 187, 251), _lost(1.0)),
        ("384x384 pixels", lambda: perturbations.resized(views, 384, 384), _lost(1.0)),
        ("64x512 pixels", lambda: perturbations.resized(views, 512, 64), _warned("pixels are")),
    ]
    doubled = views.select([0, 0, 1, 1, *range(2, len(views.images))])
    single = views.select([0, *range(2, len(views.images))])
    return (
        *_cases(made, pair, name),
        StressCase(f"{name}: every view twice", lambda: Trial(doubled, 2 * two), lambda: pair, _lost(4.0)),
        StressCase(f"{name}: one view", lambda: Trial(single, 1), lambda: pair, _warned("one view has no parallax")),
    )


def _cases(made: Sequence[Made], pair: Trial, name: str) -> tuple[StressCase, ...]:
    return tuple(
        StressCase(f"{name}: {label}", lambda make=make: Trial(make(), pair.num_context), lambda: pair, rule)  # type: ignore[misc]
        for label, make, rule in made
    )


def room_cases() -> tuple[StressCase, ...]:
    """Return the cases in a synthetic room. Their reference is the fully textured room, seen by parallel cameras."""
    room, straight = Room(painted), sideways()
    made = {
        "reference": (room, straight, _lost(0.0)),
        "no texture": (Room(blank), straight, _lost(-10.0)),
        "repetitive texture": (Room(chequered), straight, _warned(POOR)),
        "mirror": (Room(painted, reflection=0.9, transparency=0.0), straight, _lost(7.0)),
        "glass": (Room(painted, reflection=0.3, transparency=0.6), straight, _lost(2.0)),
        "thin bars": (Room(painted, transparency=0.0, has_bars=True), straight, _warned(POOR)),
        "tiny baseline": (room, sideways(0.002), _warned(APART)),
        "huge baseline": (room, sideways(2.6), _warned("hardly overlap")),
        "forward motion": (room, forwards(), _lost(3.0)),
        "pure rotation": (room, turning(), _warned(APART)),
        "opposite views": (room, facing(), _warned("is confirmed by another view")),
        "no overlap": (room, back_to_back(), _warned("hardly overlap")),
        "orbit of 8 views": (room, orbit(8), _lost(2.5)),
        "far view beside a pair": (room, with_far_view(), _warned("of view 2 is confirmed by another view")),
        "3 views": (room, along_a_line(3), _lost(0.0)),
        "8 views": (room, along_a_line(8), _lost(-2.0)),
        "16 views": (room, along_a_line(16), _lost(-1.0)),
    }

    def trial(room: Room, poses: torch.Tensor) -> Trial:
        return Trial(photograph(room, poses, CASE_SIZE), len(poses) - 1)

    return tuple(
        StressCase(
            f"room: {label}",
            lambda room=room, poses=poses: trial(room, poses),  # type: ignore[misc]
            lambda: trial(Room(painted), straight),
            rule,
        )
        for label, (room, poses, rule) in made.items()
    )


def _exposed(views: Views, gain: float, noise: float = 0.0) -> Views:
    return perturbations.exposed(views, *[(gain, gain, gain)] * len(views.images), noise=noise)
