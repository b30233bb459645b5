"""The stress cases: how each is derived from a reference scene, and the rule that its result must satisfy."""

from collections.abc import Callable
from dataclasses import dataclass

import torch

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

ROOM_SIZE = (192, 192)


@dataclass(frozen=True)
class Trial:
    """Input of one trial. views: context views, then target views."""

    views: Views
    num_context: int


@dataclass(frozen=True)
class StressCase:
    """One stress case. trial: creates its trial. reference: creates the reference trial of the same scene.

    rule: pass criterion. "finite": all Gaussians and images are finite, and the PLY can be written. "refused": the
    sender raises InputError. The other rules require "finite" and in addition: "warned", at least one input warning;
    "same picture", PSNR within 0.05 dB of the reference; "same bytes", also equal payloads; "same quality", PSNR within
    0.5 dB of the reference.
    """

    name: str
    trial: Callable[[], Trial]
    reference: Callable[[], Trial]
    rule: str = "finite"


def cases_of(pair: Trial, name: str) -> tuple[StressCase, ...]:
    """Return the cases derived from two context views with target views. name: scene name, prefix of the case names."""
    views, two = pair.views, pair.num_context
    made: list[tuple[str, Callable[[], Views], str]] = [
        ("night with noise", lambda: perturbations.exposed(views, _all(views, 0.02), noise=0.03), "finite"),
        ("black", lambda: perturbations.exposed(views, _all(views, 1e-5)), "warned"),
        ("overexposed", lambda: perturbations.exposed(views, _all(views, 4.0)), "finite"),
        ("exposure differs 4:1", lambda: _exposed(views, (2, 2, 2), (0.5, 0.5, 0.5)), "warned"),
        ("white balance differs", lambda: _exposed(views, (1.3, 1, 0.8), (0.8, 1, 1.3)), "finite"),
        ("motion blur of 9 pixels", lambda: perturbations.blurred(views, 9, two), "finite"),
        ("noise of 5%", lambda: perturbations.exposed(views, _all(views, 1.0), noise=0.05), "finite"),
        ("poses turned by 0.1 degrees", lambda: perturbations.turned(views, 0.1, two), "finite"),
        ("poses turned by 1 degree", lambda: perturbations.turned(views, 1.0, two), "finite"),
        ("poses turned by 5 degrees", lambda: perturbations.turned(views, 5.0, two), "finite"),
        ("poses moved by 1% of baseline", lambda: perturbations.moved(views, 0.01, two), "finite"),
        ("poses moved by 20% of baseline", lambda: perturbations.moved(views, 0.2, two), "finite"),
        ("baseline said to be 1%", lambda: perturbations.closer_together(views, 0.01, two), "warned"),
        ("baseline said to be 10 times", lambda: perturbations.closer_together(views, 10.0, two), "finite"),
        ("focal length 20% wrong", lambda: perturbations.with_focal(views, 1.2), "finite"),
        ("OpenGL axes", lambda: perturbations.with_axes(views, (1.0, -1.0, -1.0)), "finite"),
        ("mirrored axes", lambda: perturbations.with_axes(views, (-1.0, 1.0, 1.0)), "refused"),
        ("depth bounds 10 times too wide", lambda: perturbations.with_bounds(views, 0.1, 10.0), "finite"),
        ("depth bounds 1000 times too wide", lambda: perturbations.with_bounds(views, 1e-3, 1e3), "refused"),
        ("depth bounds beyond the scene", lambda: perturbations.with_bounds(views, 20.0, 20.0), "finite"),
        ("depth bounds before the scene", lambda: perturbations.with_bounds(views, 0.02, 0.02), "finite"),
        ("near beyond far", lambda: perturbations.with_bounds(views, 1000.0, 1.0), "refused"),
        ("unit of length 1024 times smaller", lambda: perturbations.in_other_units(views, 1024.0), "same bytes"),
        ("unit of length 1000 times smaller", lambda: perturbations.in_other_units(views, 1000.0), "same picture"),
        ("unit of length 1000 times larger", lambda: perturbations.in_other_units(views, 1e-3), "same picture"),
        ("order of views swapped", lambda: views.select([1, 0, *range(2, len(views.images))]), "same quality"),
        ("64x64 pixels", lambda: perturbations.resized(views, 64, 64), "finite"),
        ("odd size 251x187", lambda: perturbations.resized(views, 187, 251), "finite"),
        ("512x512 pixels", lambda: perturbations.resized(views, 512, 512), "finite"),
        ("64x512 pixels", lambda: perturbations.resized(views, 512, 64), "finite"),
    ]
    reference = StressCase(f"{name}: reference", lambda: pair, lambda: pair)
    others = [
        StressCase(f"{name}: {label}", lambda make=make: Trial(make(), two), lambda: pair, rule)  # type: ignore[misc]
        for label, make, rule in made
    ]
    doubled = views.select([0, 0, 1, 1, *range(2, len(views.images))])
    single = views.select([0, *range(2, len(views.images))])
    return (
        reference,
        *others,
        StressCase(f"{name}: every view twice", lambda: Trial(doubled, 4), lambda: pair),
        StressCase(f"{name}: one view", lambda: Trial(single, 1), lambda: pair, "warned"),
    )


def room_cases() -> tuple[StressCase, ...]:
    """Return the cases in a synthetic room. Their reference is the fully textured room, seen by parallel cameras."""
    plain = Room(painted)
    surfaces = {
        "no texture": Room(blank),
        "repetitive texture": Room(chequered),
        "mirror": Room(painted, reflection=0.9, transparency=0.0),
        "glass": Room(painted, reflection=0.3, transparency=0.6),
        "thin bars": Room(painted, transparency=0.0, has_bars=True),
    }
    paths = {
        "tiny baseline": (sideways(0.002), "warned"),
        "huge baseline": (sideways(2.6), "finite"),
        "forward motion": (forwards(), "finite"),
        "pure rotation": (turning(), "warned"),
        "opposite views": (facing(), "finite"),
        "no overlap": (back_to_back(), "warned"),
        "orbit of 8 views": (orbit(8), "finite"),
        "far view beside a pair": (with_far_view(), "finite"),
    }

    def trial(room: Room, poses: torch.Tensor) -> Trial:
        return Trial(photograph(room, poses, ROOM_SIZE), len(poses) - 1)

    def reference() -> Trial:
        return trial(plain, sideways())

    return (
        StressCase("room: reference", reference, reference),
        *(
            StressCase(f"room: {label}", lambda room=room: trial(room, sideways()), reference)  # type: ignore[misc]
            for label, room in surfaces.items()
        ),
        *(
            StressCase(f"room: {label}", lambda poses=poses: trial(plain, poses), reference, rule)  # type: ignore[misc]
            for label, (poses, rule) in paths.items()
        ),
        *(
            StressCase(f"room: {count} views", lambda count=count: trial(plain, along_a_line(count)), reference, rule)  # type: ignore[misc]
            for count, rule in ((1, "warned"), (3, "finite"), (8, "finite"), (16, "finite"))
        ),
    )


def _all(views: Views, gain: float) -> torch.Tensor:
    return torch.full((len(views.images), 3), gain)


def _exposed(views: Views, *gains: tuple[float, float, float]) -> Views:
    return perturbations.exposed(views, perturbations.gains_of(views, *gains))
