"""Scenes that each released model encodes once: the bundled pair, and drawn rooms of one to nine views."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fecocodec import Views, encode, read_views
from fecocodec.container import read_stream, write_stream
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph
from tests.vectors.chosen_symbols import levels_of

ROOT = Path(__file__).resolve().parents[2]
WITH_SHEET = Room(painted, transparency=0.0)  # a dark square that stands in the room, and hides walls


@dataclass(frozen=True)
class ReleasedScene:
    """Photographs, how they are encoded, and what the stream breaks. fades: with a level for every block."""

    views: Callable[[], Views]
    breaks: str
    lmbda: float = 1e-3
    fades: bool = False

    def stream(self) -> bytes:
        """Return the encoded scene, whose bytes differ between machines: the sender computes in floating point."""
        data = encode(self.views(), lmbda=self.lmbda)
        if not self.fades:
            return data
        stream = read_stream(data)
        return write_stream(replace(stream, fading=levels_of(stream.header)))


def bundled() -> Views:
    return read_views(ROOT / "examples" / "motorcycle", size=(128, 192))


def one_view() -> Views:
    return photograph(WITH_SHEET, look((0.2, 0.0, -1.5), 5.0)[None], (64, 96))


def cut_out_from_near_and_far() -> Views:
    """Return two views beside each other and one just before the sheet; the borders of the first are transparent."""
    poses = (look((-0.2, 0.0, -0.9)), look((0.2, 0.02, -0.9), -4.0), look((0.05, 0.1, 0.46), 2.0))
    views = photograph(WITH_SHEET, torch.stack(poses), (64, 64))
    alpha = torch.ones(len(poses), 64, 64)
    alpha[0, :, :12] = alpha[0, -8:] = 0.0
    return replace(views, images=views.images * alpha[:, None] + (1.0 - alpha[:, None]), alpha=alpha)


def fan() -> Views:
    poses = [look((0.22 * step, 0.03 * step**2, -1.6 + 0.25 * abs(step)), -7.0 * step) for step in range(-2, 3)]
    return photograph(WITH_SHEET, torch.stack(poses), (64, 96))


def walk() -> Views:
    poses = [look((0.1 * step - 0.4, 0.02 * step, -1.8 + 0.12 * step), 6.0 * step - 24.0) for step in range(9)]
    return photograph(WITH_SHEET, torch.stack(poses), (64, 64))


SCENES = {
    "": ReleasedScene(bundled, "one that was tried on small models only"),
    "-one-view": ReleasedScene(one_view, "one that asks for other views, or gives colours a direction without them"),
    "-three-views": ReleasedScene(
        cut_out_from_near_and_far,
        "one that keeps duplicates or what is too near to a camera, or fades before the rules between views",
        lmbda=3e-4,
        fades=True,
    ),
    "-five-views": ReleasedScene(fan, "one that takes neighbours, or other views, in another order", fades=True),
    "-nine-views": ReleasedScene(walk, "one that has room for fewer views, or takes two rules from 8 views alone"),
}
"""By what follows the name of the model in the name of the stream."""
