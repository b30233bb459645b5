"""The scene that comes with the project: small, readable, and with cameras that fit its photographs."""

from pathlib import Path

import pytest

from fecocodec.captures.scene_folder import read_views
from fecocodec.geometry.depth_range import estimate_depth_range

SCENE = Path(__file__).resolve().parents[2] / "examples" / "motorcycle"


def test_it_is_small_and_says_where_it_comes_from():
    assert sum(file.stat().st_size for file in SCENE.rglob("*") if file.is_file()) < 1_000_000
    text = (SCENE / "README.md").read_text()
    assert "Middlebury" in text
    assert "## Terms" in text


def test_its_cameras_fit_its_photographs():
    """Depths found by matching the photographs agree with the ground truth that near and far were taken from."""
    views = read_views(SCENE)
    assert views.images.shape == (2, 3, 256, 384)
    assert views.cameras.extrinsics[1, 0, 3].item() == pytest.approx(0.193001)
    near, far = estimate_depth_range(views)
    assert near == pytest.approx(views.cameras.near.item() / 1.3, rel=0.1)
    assert far == pytest.approx(views.cameras.far.item() * 1.3, rel=0.1)
