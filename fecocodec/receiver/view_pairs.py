"""Pairs of a view and another one of the same scene: all views at once, with the view `shift` positions after each.

A loop over shifts from 1 visits every ordered pair of different views once.
"""

import torch
from jaxtyping import Int64
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


def others(num_views: int, shift: int | Tensor, device: torch.device) -> Int64[Tensor, " view"]:
    """Return the index of the view `shift` positions after each view, cyclically."""
    index = torch.arange(num_views, device=device) + shift
    return torch.where(index >= num_views, index - num_views, index)


def cameras_of(cameras: Cameras, index: Int64[Tensor, " view"]) -> Cameras:
    """Return the cameras of these views of one scene."""
    return Cameras(
        cameras.extrinsics.index_select(0, index), cameras.intrinsics.index_select(0, index), cameras.near, cameras.far
    )


def shifts(num_views: int) -> range:
    """Return the shifts that visit all other views of each view."""
    return range(1, num_views)


def third_view_shifts(num_views: int) -> range:
    """Return the shifts of steps that need three or more views: none for fewer."""
    return shifts(num_views) if num_views > 2 else range(0)
