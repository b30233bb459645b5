"""Views that confirm each other's depth, and views that do not."""

import torch
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.cross_view_consistency import cross_view_consistency
from tests.example_scenes import cameras_in_a_row

PAIR = torch.tensor([[[1], [0]]])


def two_cameras(shift: float, forward: float = 0.0) -> Cameras:
    """The second one beside the first and `forward` closer to the scene."""
    cameras = cameras_in_a_row(0.0, shift, far=10.0).as_batch()
    cameras.extrinsics[0, 1, 2, 3] = forward
    return cameras


def relative_disparity(depth: float) -> float:
    return (1 / depth - 1 / 10) / (1 - 1 / 10)


def walls(*depths: float) -> Tensor:
    return torch.stack([torch.full((16, 16), relative_disparity(depth)) for depth in depths])[None]


def test_where_a_wall_is_confirmed() -> None:
    found = cross_view_consistency(walls(2.0, 2.0), two_cameras(0.5), PAIR)[0]
    # Four cells of sixteen (0.5 / 2.0 of the width) lie outside the other view, on opposite sides.
    assert float(found[0, :, 4:].min()) > 0.99
    assert float(found[0, :, :4].max()) == 0.0
    assert float(found[1, :, :-4].min()) > 0.99
    assert float(found[1, :, -4:].max()) == 0.0
    kept = torch.ones(1, 2, 16, 16)
    kept[0, 1, :8] = 0.0
    found = cross_view_consistency(walls(2.0, 2.0), two_cameras(0.5), PAIR, kept)[0]
    assert float(found[:, :7].max()) == 0.0
    assert float(found[0, 9:, 4:].min()) > 0.99 and float(found[1, 9:, :-4].min()) > 0.99
    three = two_cameras(0.2).select([0, 1, 1])
    found = cross_view_consistency(walls(2.0, 5.0, 2.0), three, torch.tensor([[[1, 2], [0, 2], [0, 1]]]))
    assert float(found[0, 0, :, 4:].min()) > 0.99
    cameras = two_cameras(0.2).select([0])
    assert float(cross_view_consistency(walls(2.0), cameras, torch.zeros(1, 1, 0, dtype=torch.long)).max()) == 0.0


def test_depth_is_carried_over_and_compared() -> None:
    cameras = two_cameras(0.0, forward=0.5)
    assert float(cross_view_consistency(walls(2.0, 1.5), cameras, PAIR)[0, 0, 4:-4, 4:-4].min()) > 0.99
    assert float(cross_view_consistency(walls(2.0, 2.0), cameras, PAIR)[0, 0].max()) < 0.05
    means = [
        float(cross_view_consistency(walls(2.0, other), two_cameras(0.2), PAIR)[0, 0, :, 4:].mean())
        for other in (2.0, 2.1, 3)
    ]
    assert means[0] > means[1] + 0.2 > means[2] + 0.4
