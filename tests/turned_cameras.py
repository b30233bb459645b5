"""Views with a wrong pose."""

import math
from dataclasses import replace

from fecocodec.geometry.rotations import matrix_from_quaternion
from fecocodec.geometry.views import Views


def with_turned_camera(views: Views, view: int, degrees: float) -> Views:
    """Turn one camera about its x axis, which moves pictures off the epipolar lines of cameras side by side."""
    half = math.radians(degrees) / 2
    extrinsics = views.cameras.extrinsics.clone()
    turn = matrix_from_quaternion(extrinsics.new_tensor([math.cos(half), math.sin(half), 0.0, 0.0]))
    extrinsics[view, :3, :3] = extrinsics[view, :3, :3] @ turn
    return replace(views, cameras=replace(views.cameras, extrinsics=extrinsics))
