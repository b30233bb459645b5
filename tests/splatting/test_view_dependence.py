"""View-dependent colours fit the colours seen from the other views."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, SH_DEGREE_1, Gaussians
from fecocodec.splatting.view_dependence import view_dependent
from tests.example_scenes import cameras_in_a_row, surface

SIDE = 16  # Gaussians a side
WALL = 4.0
CONFIG = ReceiverConfig()
CENTRE = (SIDE // 2, SIDE // 2)


def wall(cameras: Cameras, grey: list[float], depth: list[float]) -> Gaussians:
    """Return one wall per view, each of one grey."""
    colours, depths = (torch.tensor(of)[:, None, None].expand(-1, SIDE, SIDE) for of in (grey, depth))
    return surface(cameras, depths, colours[..., None].expand(-1, -1, -1, 3), 0.7)


def seen(gaussians: Gaussians, cameras: Cameras, of: int, by: int) -> Tensor:
    """Return the grey of the central Gaussian of view `of` in the direction of the camera of view `by` (3DGS basis)."""
    place = of * SIDE * SIDE + CENTRE[0] * SIDE + CENTRE[1]
    x, y, z = torch.nn.functional.normalize(gaussians.means[place] - cameras.extrinsics[by, :3, 3], dim=0).tolist()
    basis = torch.tensor([SH_DEGREE_0, -SH_DEGREE_1 * y, SH_DEGREE_1 * z, -SH_DEGREE_1 * x])
    return 0.5 + basis @ gaussians.harmonics[place][:, 0]


def dependent(cameras: Cameras, grey: list[float], depth: list[float], **change: float) -> Gaussians:
    return view_dependent(wall(cameras, grey, depth), cameras, (SIDE, SIDE), replace(CONFIG, **change))


def test_a_colour_stays_in_its_own_view_and_leans_towards_what_another_view_shows() -> None:
    cameras = cameras_in_a_row(0.0, 1.0)
    found = dependent(cameras, [0.2, 0.6], [WALL, WALL])
    assert seen(found, cameras, 0, 0) == pytest.approx(0.2, abs=1e-5)
    assert seen(found, cameras, 1, 1) == pytest.approx(0.6, abs=1e-5)
    turn = 2 * math.sin(math.atan(1 / WALL) / 2)  # approximate, because the centre of the wall is slightly off-axis
    share = CONFIG.view_dependence / (1 + (CONFIG.view_dependence_ridge / turn) ** 2)
    assert seen(found, cameras, 0, 1) == pytest.approx(0.2 + share * 0.4, abs=0.005)
    assert seen(found, cameras, 1, 0) == pytest.approx(0.6 - share * 0.4, abs=0.005)


def test_all_the_way_three_views_see_their_own_colours() -> None:
    cameras = cameras_in_a_row(0.0, 1.0, -1.0)
    cameras.extrinsics[2, 1, 3] = 1.0  # not collinear, so that a linear function can fit all three colours
    greys = [0.3, 0.5, 0.8]
    found = dependent(cameras, greys, [WALL] * 3, view_dependence=1.0, view_dependence_ridge=1e-3)
    for by, grey in enumerate(greys):
        assert seen(found, cameras, 0, by) == pytest.approx(grey, abs=0.01)


def test_what_another_view_shows_in_front_of_a_gaussian_tells_nothing_of_its_colour() -> None:
    cameras = cameras_in_a_row(0.0, 1.0)
    found = dependent(cameras, [0.2, 0.6], [WALL, 0.6 * WALL])
    assert seen(found, cameras, 0, 1) == pytest.approx(0.2, abs=1e-3)
    assert seen(found, cameras, 1, 0) < 0.5  # in front of the first view's surface, which does not occlude it


@pytest.mark.parametrize("positions", [pytest.param((0.0, 100.0), id="elsewhere"), pytest.param((0.0, 0.0), id="same")])
def test_a_view_that_sees_nothing_of_it_or_stands_at_the_same_place_changes_nothing(
    positions: tuple[float, ...],
) -> None:
    cameras = cameras_in_a_row(*positions)
    found = dependent(cameras, [0.2, 0.6], [WALL, WALL])
    assert found.harmonics[:, 1:].abs().max() == 0.0
    assert torch.equal(found.harmonics[:, :1], wall(cameras, [0.2, 0.6], [WALL, WALL]).harmonics)


def test_gaussians_that_are_left_as_they_are() -> None:
    cameras = cameras_in_a_row(0.0)
    gaussians = wall(cameras, [0.2], [WALL])
    assert view_dependent(gaussians, cameras, (SIDE, SIDE), CONFIG) is gaussians
    cameras = cameras_in_a_row(0.0, 1.0)
    found = dependent(cameras, [0.2, 0.6], [WALL, WALL])
    assert view_dependent(found, cameras, (SIDE, SIDE), CONFIG) is found
    gaussians = wall(cameras, [0.2, 0.6], [WALL, WALL])
    gaussians.means[5] = torch.inf
    found = view_dependent(gaussians, cameras, (SIDE, SIDE), CONFIG)
    assert found.harmonics.isfinite().all()
