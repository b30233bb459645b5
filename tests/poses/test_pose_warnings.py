"""Warnings about estimated cameras: drawn photographs that determine the cameras, and two that do not."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from fecocodec.poses.posed_folder import posed_folder

pytest.importorskip("pycolmap")
WIDTH, HEIGHT, FOCAL = 240, 180, 180.0  # the focal length is the initial one, 0.75 of the longer side
# Planes: axis of the normal, coordinate along it. A floor, two walls, and boards in front of the walls.
PLANES = ((1, 1.6, 99.0), (2, 8.0, 99.0), (0, -4.0, 99.0), (2, 5.0, 0.9), (0, 2.2, 2.0))


@cache
def texture(number: int) -> np.ndarray:
    noise = np.random.default_rng(number).normal(size=(512, 512))
    return gaussian_filter(noise, 1.5, mode="wrap") * 3 + gaussian_filter(noise, 6, mode="wrap") * 9


def draw(path: Path, turn: float, position: tuple[float, float, float], focal: float = FOCAL) -> None:
    """Draw textured planes as seen by a camera that is turned by `turn` degrees about the vertical axis."""
    rows, columns = np.meshgrid(np.arange(HEIGHT) + 0.5, np.arange(WIDTH) + 0.5, indexing="ij")
    local = np.stack(((columns - WIDTH / 2) / focal, (rows - HEIGHT / 2) / focal, np.ones_like(rows)))
    angle = np.radians(turn)
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    rays = np.einsum("ij,jhw->ihw", rotation, local)
    nearest, image = np.full(rows.shape, np.inf), np.zeros(rows.shape)
    for number, (axis, coordinate, half_size) in enumerate(PLANES):
        with np.errstate(divide="ignore"):
            distance = (coordinate - position[axis]) / rays[axis]
        point = np.array(position)[:, None, None] + distance * rays
        across = np.delete(point, axis, axis=0)
        is_seen = (distance > 0) & (distance < nearest) & (np.abs(across[0 if axis == 2 else 1]) < half_size)
        is_seen &= np.abs(across[1 if axis == 2 else 0]) < half_size
        values = map_coordinates(texture(number), np.where(is_seen, across, 0) * 60, order=1, mode="grid-wrap")
        image = np.where(is_seen, values, image)
        nearest = np.where(is_seen, distance, nearest)
    Image.fromarray((128 + 60 * image).clip(0, 255).astype(np.uint8)).convert("RGB").save(path)


def test_four_photographs_from_different_positions_are_not_warned_of(tmp_path):
    """The cameras are the same with one thread and with two. A given focal length is kept."""
    for number, (turn, x) in enumerate(((24.0, -2.4), (8.0, -0.8), (-8.0, 0.8), (-24.0, 2.0))):
        draw(tmp_path / f"{number}.png", turn, (x, 0.1 * number, 0.3 * abs(x)))
    found = []
    for num_threads in (1, 2):
        with posed_folder(tmp_path, num_threads=num_threads) as posed:
            assert "4 of 4" in posed.notes[0]
            assert posed.warnings == ()
            found.append(posed.reconstruction.cameras)
    assert found[0][0].lens.fx == pytest.approx(FOCAL, rel=0.02)
    for first, second in zip(*found, strict=True):
        assert first.lens == second.lens and np.array_equal(first.camera_to_world, second.camera_to_world)
    wrong = 1.1 * FOCAL  # as the matches show
    with posed_folder(tmp_path, num_threads=1, focal_px=wrong) as posed:
        assert "focal length 198 pixels for 240x180 (as given); the unit" in posed.notes[0]
        assert [camera.lens.fx for camera in posed.reconstruction.cameras] == pytest.approx([wrong] * 4, rel=1e-12)


def test_a_long_lens_on_which_estimates_agree_is_not_warned_of(tmp_path):
    for number, (turn, x) in enumerate(((16.0, -1.7), (6.0, -0.6), (-6.0, 0.6), (-16.0, 1.5))):
        draw(tmp_path / f"{number}.png", turn, (x, 0.1 * number, 0.3 * abs(x)), 1.7 * FOCAL)
    with posed_folder(tmp_path, num_threads=1) as posed:
        assert "4 of 4" in posed.notes[0]
        assert posed.reconstruction.cameras[0].lens.fx == pytest.approx(1.7 * FOCAL, rel=0.02)
        assert posed.warnings == ()


def test_a_pure_shift_between_two_photographs_is_warned_of(tmp_path):
    for number, x in enumerate((-0.3, 0.3)):
        draw(tmp_path / f"{number}.png", 0.0, (x, 0, 0))
    with posed_folder(tmp_path, num_threads=1) as posed:
        (warning,) = posed.warnings
        assert "two photographs do not determine their focal length here" in warning
