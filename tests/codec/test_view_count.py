"""How many photographs are coded, by rate and distortion."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec import EncodingOptions, encode_folder
from fecocodec.codec.view_count import Judged, best_count
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.geometry.views import Views
from tests.example_scenes import write_views

OPTIONS = EncodingOptions(effort="fast", num_stages=1, num_checks=0)
AT_1E_3 = quantise_lambda(1e-3)


def room(centres: list[tuple[float, float, float]]) -> Views:
    return photograph(Room(painted), torch.stack([look(centre) for centre in centres]), (96, 128))


def judge(gain_db: float) -> Callable[[int], Judged]:
    """A scene in which each doubling of the coded views gains so many dB, at half a bit a pixel."""
    return lambda count: Judged(count, -0.0023026 * gain_db * math.log2(count), 2_000 * count, 0.5)


@pytest.mark.parametrize(("gain_db", "count"), [(0.0, 2), (0.3, 2), (0.5, 16), (2.0, 16)])
def test_more_views_must_gain_as_much_as_finer_coding(gain_db: float, count: int) -> None:
    """At half a bit a pixel and lambda 1e-3, a doubling of the bytes has to gain 0.4 dB."""
    assert best_count(judge(gain_db), 16, AT_1E_3)[0].count == count


def test_smaller_files_have_fewer_views() -> None:
    assert [best_count(judge(0.4), 16, quantise_lambda(lmbda))[0].count for lmbda in (1e-2, 1e-4)] == [2, 16]


def test_numbers_beside_the_best_are_judged() -> None:
    seen = []

    def saturating(count: int) -> Judged:
        seen.append(count)
        return Judged(count, -0.02 * min(count, 6), 2_000 * count, 0.5)

    best, more = best_count(saturating, 16, AT_1E_3)
    assert best.count == 6 and more is not None and more.count == 8
    assert seen == [2, 4, 8, 16, 6, 12]
    assert best_count(saturating, 5, AT_1E_3) == (saturating(5), None)
    assert best_count(saturating, 1, AT_1E_3) == (saturating(1), None)


def test_a_wall_takes_fewer_views_than_a_walk(tmp_path: Path) -> None:
    write_views(tmp_path / "wall", room([(0.04 * step, 0.0, -1.5) for step in range(8)]))
    write_views(tmp_path / "walk", room([(0.45 * step - 1.6, 0.1 * step, -1.5) for step in range(8)]))
    wall, walk = (encode_folder(tmp_path / name, OPTIONS) for name in ("wall", "walk"))
    assert len(wall.names) == 2 < len(walk.names)
    assert len(wall.guides.names) + wall.num_unused == 6
    assert any(note.startswith("2 photographs are coded; 3 would take 1.") for note in wall.notes)


def test_a_photograph_of_another_scene_is_not_coded(tmp_path: Path) -> None:
    views = room([(step, 0.05 * step, -1.5) for step in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)])
    other = photograph(Room(lambda points: waves(points, 9)), views.cameras.extrinsics, (96, 128))
    images = views.images.clone()
    images[3] = other.images[3].flip(-2)
    write_views(tmp_path, replace(views, images=images))
    report = encode_folder(tmp_path, OPTIONS)
    assert len(report.names) >= 2 and "3.png" not in (*report.names, *report.guides.names)
    assert any(warning.startswith("guide 3.png is left out") for warning in report.warnings)
