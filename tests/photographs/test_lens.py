"""Lens models give COLMAP's numbers, and the inverse of what distorts."""

import numpy as np
import pytest

from fecocodec.errors import InputError
from fecocodec.photographs.lens import MAX_SLOPE, Lens, distort, lens_of_model, undistorted

# Camera parameters of COLMAP's own tests (models_test.cc), and what `pycolmap.Camera.img_from_cam` of pycolmap 4.2.1
# gives for the points (0.16435402478574512, -0.27625594348335564, 1) and (-0.5508317712765664, -0.580166837365765, 1).
CENTRE = {"fx": 651.123, "fy": 655.123, "cx": 386.123, "cy": 511.123}
POINTS = np.array([[0.16435402478574512, -0.27625594348335564], [-0.5508317712765664, -0.580166837365765]])
COLMAP = {
    "OPENCV_FISHEYE": (
        {"k1": -0.471, "k2": 0.223, "k3": -0.001, "k4": 0.001},
        [[485.1632105246987, 343.6276896525466], [134.52147805329142, 244.4942399048199]],
    ),
    "FULL_OPENCV": (
        {"k1": -0.471, "k2": 0.223, "p1": -0.001, "p2": 0.001, "k3": 0.001, "k4": 0.02, "k5": -0.02, "k6": 0.001},
        [[488.157082898349, 338.61058763900223], [104.49354465789565, 211.8119490389214]],
    ),
}
SIZE = (800, 1000)


@pytest.mark.parametrize("model", COLMAP)
def test_points_fall_where_colmap_has_them(model: str) -> None:
    coefficients, expected = COLMAP[model]
    lens = lens_of_model(model, SIZE, CENTRE | coefficients)
    np.testing.assert_allclose(distort(lens, POINTS) * (lens.fx, lens.fy) + (lens.cx, lens.cy), expected, atol=1e-9)


def corners(pinhole: Lens) -> np.ndarray:
    """Corners of the image of a pinhole, on the plane z = 1."""
    edges = np.array([[u, v] for u in (0, pinhole.width) for v in (0, pinhole.height)])
    return (edges - (pinhole.cx, pinhole.cy)) / (pinhole.fx, pinhole.fy)


@pytest.mark.parametrize("model", COLMAP)
def test_the_undistorted_image_lies_inside_the_photograph(model: str) -> None:
    lens = lens_of_model(model, SIZE, CENTRE | COLMAP[model][0])
    pinhole = undistorted(lens, "a")
    seen = distort(lens, corners(pinhole)) * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    assert not pinhole.has_distortion
    assert (pinhole.fx, pinhole.fy) == (lens.fx, lens.fy)
    assert (seen > -0.5).all() and (seen < np.array(SIZE) + 0.5).all()


def test_polynomials_are_used_as_far_as_they_have_an_inverse() -> None:
    # An equidistant circle of 800 pixels; its corners, beyond 90 degrees, are outside of every pinhole.
    focal = 400 / (np.pi / 2)
    lens = lens_of_model("FISHEYE", (800, 800), {"fx": focal, "fy": focal, "cx": 400.0, "cy": 400.0})
    pinhole = undistorted(lens, "a")
    assert abs(pinhole.width / 2 - focal * MAX_SLOPE) < 1.5
    assert abs(pinhole.height / 2 - focal * MAX_SLOPE) < 1.5
    # theta (1 - theta^2) rises up to 33 degrees; farther rays have no inverse.
    lens = lens_of_model("OPENCV_FISHEYE", (400, 400), {"fx": 300.0, "fy": 300.0, "cx": 200.0, "cy": 200.0, "k1": -1.0})
    slope = np.abs(corners(undistorted(lens, "a"))).max()
    assert 0.3 < slope < np.tan(1 / np.sqrt(3))
    lens = lens_of_model("FULL_OPENCV", SIZE, CENTRE | {"k4": -4.0})
    with pytest.raises(InputError, match="a: its lens distortion has no inverse inside the image"):
        undistorted(lens, "a")
