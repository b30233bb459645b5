"""Training samples, and augmentation of photographed frames: crop, resize, mirror and tint, with adjusted cameras."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views
from fecocodec.photographs.lens import Lens

CROP_SPREAD = 0.1  # of the windows of a scene's frames, as a share of the room that they have


@dataclass(frozen=True)
class Sample:
    """One training example.

    views: the context views first, then the target views; one set of near and far for all.
    num_context: how many of the views are context.
    depth: z along the optical axis in scene units at pixel centres, exact; None for photographs.
    skipped: one sentence for each scene that was drawn before this one and could not be used.
    """

    views: Views
    num_context: int
    depth: Float[Tensor, "view height width"] | None
    skipped: tuple[str, ...] = ()


@runtime_checkable
class SampleSource(Protocol):
    """A source of training samples."""

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw one scene; size: (height, width) in pixels. Equal generator states give equal samples."""


@dataclass(frozen=True)
class Captured:
    """Frames of one scene and camera, at their stored size. extrinsics: camera-to-world, OpenCV axes, scene units."""

    images: list[UInt8[Tensor, "3 _ _"]]
    names: tuple[str, ...]
    lens: Lens
    extrinsics: Float[np.ndarray, "frame 4 4"]
    near: float
    far: float


_Crop = tuple[int, int, int, int]
"""A window of a stored photograph: top, left, height and width in pixels."""


def augment(
    rng: np.random.Generator, scene: Captured, num_context: int, size: tuple[int, int], spread: float
) -> Sample:
    """Crop, resize, mirror at random and tint frames, and adjust the cameras. size: (height, width) in pixels.

    spread: largest distance of a frame's window from their common position, as a share of the room. With 0 all frames
    have one window, and so equal intrinsics, which the public geometry of depthsplat-small requires.
    """
    crops = _crops(rng, (scene.lens.height, scene.lens.width), len(scene.images), size, spread)
    images = [_resized(image, crop, size) for image, crop in zip(scene.images, crops, strict=True)]
    intrinsics = torch.stack([_cropped_intrinsics(scene.lens, crop) for crop in crops])
    cameras = Cameras.in_float32(scene.extrinsics, intrinsics, scene.near, scene.far)
    views = Views(_tinted(rng, torch.stack(images)), cameras, scene.names)
    return Sample(mirrored(views) if rng.random() < 0.5 else views, num_context, None)


def mirrored(views: Views) -> Views:
    """Mirror the images left to right, and the cameras with the world's x negated.

    Mirroring an image negates x of the camera axes. Conjugating the extrinsics with diag(-1, 1, 1) negates x of the
    world, too, so that rotations stay proper.
    """
    negate = torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0]))
    intrinsics = views.cameras.intrinsics.clone()
    intrinsics[:, 0, 2] = 1 - intrinsics[:, 0, 2]
    cameras = Cameras(negate @ views.cameras.extrinsics @ negate, intrinsics, views.cameras.near, views.cameras.far)
    return Views(views.images.flip(-1), cameras, views.names)


def _crops(
    rng: np.random.Generator, stored: tuple[int, int], count: int, size: tuple[int, int], spread: float
) -> list[_Crop]:
    """Draw windows of one size, 60-100% of the largest that fits, each near one common random position."""
    share = rng.uniform(0.6, 1.0) * min(stored[0] / size[0], stored[1] / size[1])
    window = (max(round(size[0] * share), 1), max(round(size[1] * share), 1))
    room = np.array([stored[0] - window[0], stored[1] - window[1]])
    # Photographers keep the subject in the middle; far corners of different frames would not overlap.
    middle = rng.uniform(0.25, 0.75, 2)
    corners = np.clip(middle + rng.uniform(-spread, spread, (count, 2)), 0, 1) * room
    return [(int(top), int(left), *window) for top, left in corners]


def _resized(image: UInt8[Tensor, "3 h w"], crop: _Crop, size: tuple[int, int]) -> Float[Tensor, "3 height width"]:
    """Resize a window with antialiasing (area-weighted); returns sRGB in [0, 1]."""
    top, left, height, width = crop
    window = image[None, :, top : top + height, left : left + width]
    resized = torch.nn.functional.interpolate(window, size, mode="bilinear", antialias=True, align_corners=False)
    return resized[0].float() / 255


def _cropped_intrinsics(lens: Lens, crop: _Crop) -> Float[Tensor, "3 3"]:
    """Return the normalised intrinsics of a window of a photograph."""
    top, left, height, width = crop
    focal_x, centre_x = lens.fx / width, (lens.cx - left) / width
    focal_y, centre_y = lens.fy / height, (lens.cy - top) / height
    return torch.tensor([[focal_x, 0.0, centre_x], [0.0, focal_y, centre_y], [0.0, 0.0, 1.0]])


def _tinted(rng: np.random.Generator, images: Float[Tensor, "view 3 h w"]) -> Float[Tensor, "view 3 h w"]:
    """Apply one mild change of brightness, white balance and contrast to all views."""
    gain = torch.from_numpy(np.exp(rng.normal(0, 0.08) + rng.normal(0, 0.04, (3, 1, 1)))).float()
    gamma = float(np.exp(rng.normal(0, 0.1)))
    return (images * gain).clamp(0, 1) ** gamma
