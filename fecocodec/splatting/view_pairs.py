"""Pairs of a view and another one of the same scene: all views at once, with the view `shift` positions after each.

A loop over shifts from 1 visits every ordered pair of different views once.
"""

from collections.abc import Iterator

import torch
from jaxtyping import Int64
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


def other_views(cameras: Cameras, *, fewest: int = 2) -> Iterator[tuple[Int64[Tensor, " view"], Cameras]]:
    """Yield for every shift the index of each view's other view, and the cameras of these other views.

    cameras: of one scene. Yields nothing for fewer views than `fewest`.
    """
    views = cameras.num_views
    for shift in range(1, views if views >= fewest else 1):
        index = (torch.arange(views, device=cameras.extrinsics.device) + shift) % views
        extrinsics, intrinsics = (x.index_select(0, index) for x in (cameras.extrinsics, cameras.intrinsics))
        yield index, Cameras(extrinsics, intrinsics, cameras.near, cameras.far)
