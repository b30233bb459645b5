"""Perturbations of views: each degrades the images, the cameras or the depth bounds in one way."""

import math
from dataclasses import replace

import torch
import torch.nn.functional as F
from scipy.spatial.transform import Rotation
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views


def exposed(views: Views, *gains: tuple[float, float, float], noise: float = 0.0) -> Views:
    """Multiply linear light by (red, green, blue) gains of the first views, and add Gaussian noise to all.

    noise: standard deviation, of sRGB in [0, 1].
    """
    of_views = torch.ones(len(views.images), 3)
    of_views[: len(gains)] = torch.tensor(gains)
    light = views.images.clamp_min(1e-6) ** 2.2 * of_views[:, :, None, None]
    grain = noise * torch.randn(views.images.shape, generator=torch.Generator().manual_seed(0))
    return replace(views, images=(light ** (1 / 2.2) + grain).clamp(0, 1))


def blurred(views: Views, length_px: int, num_context: int) -> Views:
    """Apply horizontal motion blur of `length_px` pixels to the context views."""
    kernel = torch.full((3, 1, 1, length_px), 1.0 / length_px)
    padded = F.pad(views.images, (length_px // 2, length_px - 1 - length_px // 2, 0, 0), mode="replicate")
    smeared = F.conv2d(padded, kernel, groups=3)
    images = torch.cat((smeared[:num_context], views.images[num_context:]))
    return replace(views, images=images)


def turned(views: Views, degrees: float, num_context: int) -> Views:
    """Rotate the poses of the context views by `degrees` about random axes."""
    generator = torch.Generator().manual_seed(0)
    extrinsics = views.cameras.extrinsics.clone()
    for view in range(num_context):
        axis = torch.randn(3, generator=generator)
        turn = math.radians(degrees) * (axis / axis.norm()).double().numpy()
        extrinsics[view, :3, :3] @= torch.from_numpy(Rotation.from_rotvec(turn).as_matrix()).float()
    return _with_cameras(views, extrinsics=extrinsics)


def moved(views: Views, share: float, num_context: int) -> Views:
    """Translate the poses of the context views in random directions by a fraction `share` of the baseline."""
    generator = torch.Generator().manual_seed(0)
    extrinsics = views.cameras.extrinsics.clone()
    baseline = (extrinsics[0, :3, 3] - extrinsics[1, :3, 3]).norm()
    for view in range(num_context):
        direction = torch.randn(3, generator=generator)
        extrinsics[view, :3, 3] += share * baseline * direction / direction.norm()
    return _with_cameras(views, extrinsics=extrinsics)


def closer_together(views: Views, share: float, num_context: int) -> Views:
    """Scale all camera positions about the centre of the context cameras by `share`; images do not change."""
    extrinsics = views.cameras.extrinsics.clone()
    middle = extrinsics[:num_context, :3, 3].mean(dim=0)
    extrinsics[:, :3, 3] = middle + share * (extrinsics[:, :3, 3] - middle)
    return _with_cameras(views, extrinsics=extrinsics)


def in_other_units(views: Views, factor: float) -> Views:
    """Change the unit of length: multiply camera positions, near and far by `factor`."""
    extrinsics = views.cameras.extrinsics.clone()
    extrinsics[:, :3, 3] *= factor
    return _with_cameras(views, extrinsics=extrinsics, near=views.cameras.near * factor, far=views.cameras.far * factor)


def with_bounds(views: Views, near_factor: float, far_factor: float) -> Views:
    """Multiply the depth bounds near and far by one factor each."""
    return _with_cameras(views, near=views.cameras.near * near_factor, far=views.cameras.far * far_factor)


def with_focal(views: Views, factor: float) -> Views:
    """Multiply the focal length of every camera by `factor`."""
    intrinsics = views.cameras.intrinsics.clone()
    intrinsics[:, 0, 0] *= factor
    intrinsics[:, 1, 1] *= factor
    return _with_cameras(views, intrinsics=intrinsics)


def with_axes(views: Views, signs: tuple[float, float, float]) -> Views:
    """Multiply the camera axes by signs: (1, -1, -1) is OpenGL read as OpenCV, (-1, 1, 1) is mirrored."""
    extrinsics = views.cameras.extrinsics.clone()
    extrinsics[:, :3, :3] = extrinsics[:, :3, :3] * torch.tensor(signs)
    return _with_cameras(views, extrinsics=extrinsics)


def resized(views: Views, height: int, width: int) -> Views:
    """Resize without keeping the aspect ratio; normalised intrinsics do not change."""
    images = F.interpolate(views.images, (height, width), mode="bicubic", antialias=True, align_corners=False)
    return replace(views, images=images.clamp(0, 1))


def _with_cameras(views: Views, **changed: Tensor) -> Views:
    cameras: Cameras = replace(views.cameras, **changed)
    return replace(views, cameras=cameras)
