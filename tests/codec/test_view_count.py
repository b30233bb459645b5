"""How many photographs are coded: as many as show what all show."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec import EncodingOptions, encode_folder
from fecocodec.codec.guide_choice import shown_note
from fecocodec.codec.view_count import best_count, shown_shares
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph, waves
from fecocodec.geometry.views import Views
from tests.example_scenes import write_views

pytestmark = pytest.mark.usefixtures("found_once")
OPTIONS = EncodingOptions(effort="fast", num_stages=1, num_checks=0, is_measured=False)


def room(centres: list[tuple[float, float, float]]) -> Views:
    return photograph(Room(painted), torch.stack([look(centre) for centre in centres]), (64, 80))


@pytest.mark.parametrize(("gain", "count"), [(0.0, 2), (0.029, 2), (0.031, 16), (0.1, 16)])
def test_doubling_the_views_must_gain_three_hundredths_of_what_is_shown(gain: float, count: int) -> None:
    assert best_count(np.array([gain * math.log2(views) for views in range(1, 17)])) == count


def test_views_are_added_while_they_show_more() -> None:
    assert best_count(np.array([0.3, 0.5, 0.7, 0.8, 0.9, 0.904, 0.908, 0.91])) == 5
    assert best_count(np.array([0.7])) == 1
    beside, apart = look((0.05, 0.0, -1.5)), look((9.0, 0.0, -1.5))
    poses = torch.stack([look((0.0, 0.0, -1.5)), beside, apart])
    cameras = photograph(Room(painted), poses, (64, 96)).cameras
    shares = shown_shares(cameras, [0, 2, 1]).mean(axis=0)
    assert 0.6 < shares[0] < 0.7 and 0.9 < shares[1] < 1.0 and shares[2] == 1.0


def test_a_wall_takes_fewer_views_than_a_walk(tmp_path: Path, uncoded: None) -> None:
    write_views(tmp_path / "wall", room([(0.04 * step, 0.0, -1.5) for step in range(8)]))
    write_views(tmp_path / "walk", room([(0.45 * step - 1.6, 0.1 * step, -1.5) for step in range(8)]))
    wall, walk = (encode_folder(tmp_path / name, OPTIONS) for name in ("wall", "walk"))
    assert len(wall.names) == 2 < len(walk.names)
    assert len(wall.guides.names) + wall.num_unused == 6
    assert "2 photographs are coded; on average they show 100% of each photograph." in wall.notes


def test_a_photograph_of_another_scene_is_not_coded(tmp_path: Path) -> None:
    views = room([(step, 0.05 * step, -1.5) for step in (-1.0, -0.6, -0.2, 0.2, 0.6, 1.0)])
    other = photograph(Room(lambda points: waves(points, 9)), views.cameras.extrinsics, (64, 80))
    images = views.images.clone()
    images[3] = other.images[3].flip(-2)
    write_views(tmp_path, replace(views, images=images))
    report = encode_folder(tmp_path, OPTIONS)
    assert len(report.names) >= 2 and "3.png" not in (*report.names, *report.guides.names)
    assert any(warning.startswith("guide 3.png is left out") for warning in report.warnings)


def test_the_share_leaves_out_what_overlaps_too_little() -> None:
    shares = {0: 1.0, 1: 1.0, 2: 0.7, 3: 0.0}
    start = "2 photographs are coded; on average they show"
    assert shown_note(2, shares, [3, 5]) == f"{start} 90% of each photograph except 2 with too little overlap."
    assert shown_note(2, {0: 1.0, 1: 0.5}, ()) == f"{start} 75% of each photograph."
