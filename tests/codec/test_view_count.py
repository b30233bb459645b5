"""How many photographs are coded, by rate and distortion."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec import EncodingOptions, encode_folder
from fecocodec.codec.view_count import Judged, best_count, counts_up_to
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.geometry.views import Views
from tests.example_scenes import write_views

OPTIONS = EncodingOptions(effort="fast", num_stages=1, num_checks=0)
AT_1E_3 = quantise_lambda(1e-3)


def room(centres: list[tuple[float, float, float]]) -> Views:
    return photograph(Room(painted), torch.stack([look(centre) for centre in centres]), (96, 128))


def test_all_numbers_up_to_the_most_are_judged() -> None:
    assert counts_up_to(16) == [2, 3, 4, 6, 8, 12, 16]
    assert counts_up_to(7) == [2, 3, 4, 6, 7]
    assert counts_up_to(1) == [1]


@pytest.mark.parametrize(("gain_db", "count"), [(0.0, 2), (1.4, 2), (1.8, 8), (4.0, 8)])
def test_more_views_must_gain_as_much_as_finer_coding(gain_db: float, count: int) -> None:
    """At half a bit a pixel and lambda 1e-3, four times the bytes have to gain 1.6 dB."""
    judged = [Judged(2, 0.0, 10_000, 0.5), Judged(8, -0.0023026 * gain_db, 40_000, 0.5)]
    assert best_count(judged, AT_1E_3) == count


def test_smaller_files_have_fewer_views() -> None:
    judged = [Judged(2, 0.0, 10_000, 0.5), Judged(8, -0.004, 40_000, 0.5)]
    assert [best_count(judged, quantise_lambda(lmbda)) for lmbda in (1e-2, 1e-4)] == [2, 8]


def test_a_wall_takes_fewer_views_than_a_walk(tmp_path: Path) -> None:
    write_views(tmp_path / "wall", room([(0.04 * step, 0.0, -1.5) for step in range(8)]))
    write_views(tmp_path / "walk", room([(0.45 * step - 1.6, 0.1 * step, -1.5) for step in range(8)]))
    wall, walk = (encode_folder(tmp_path / name, OPTIONS) for name in ("wall", "walk"))
    assert len(wall.names) == 2 < len(walk.names)
    assert len(wall.guides.names) + wall.num_unused == 6


def test_a_photograph_of_another_scene_is_not_coded(tmp_path: Path) -> None:
    views = room([(step, 0.05 * step, -1.5) for step in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)])
    other = photograph(Room(lambda points: waves(points, 9)), views.cameras.extrinsics, (96, 128))
    images = views.images.clone()
    images[3] = other.images[3].flip(-2)
    write_views(tmp_path, replace(views, images=images))
    report = encode_folder(tmp_path, OPTIONS)
    assert len(report.names) >= 2 and "3.png" not in report.names
    assert any(warning.startswith("guide 3.png is left out") for warning in report.warnings)
