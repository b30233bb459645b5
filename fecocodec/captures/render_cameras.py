"""Read cameras to render at: of a scene folder, a camera file or a camera path. Photographs are not needed."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from fecocodec.camera_files.find import read_cameras
from fecocodec.camera_files.nerfstudio_path import read_camera_path
from fecocodec.camera_files.posed_photographs import known_pinhole, require_float32_range, rigid_pose
from fecocodec.captures.archives import unpacked
from fecocodec.captures.view_choice import select_views
from fecocodec.captures.view_selection import Selection
from fecocodec.captures.view_spread import known_depth_bounds
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.input_file import StrPath
from fecocodec.photographs.framing import common_size, framed_intrinsics
from fecocodec.photographs.lens import Lens

LARGEST_SIDE = 4096  # pixels of a rendering


@dataclass(frozen=True)
class RenderCameras:
    """Cameras to render at.

    cameras: near and far are NaN if `has_depth_bounds` is false. image_size: (height, width) in pixels. names: one per
    camera, without suffix. frames_per_second: that of a camera path, None if it states none. notes: one sentence for
    each choice that reading made, and for cameras that were passed over.
    """

    cameras: Cameras
    image_size: tuple[int, int]
    names: tuple[str, ...]
    has_depth_bounds: bool
    frames_per_second: float | None
    notes: tuple[str, ...] = ()


def read_render_cameras(
    path: StrPath, *, views: Selection | None = None, size: tuple[int, int] | None = None
) -> RenderCameras:
    """Read cameras from a scene folder or a ZIP archive of it, a camera file, a COLMAP model or a camera path.

    The image size is `size` = (height, width), else that of a camera path, else that of `read_views`: the most frequent
    size of the photographs, or of the camera file where a photograph is missing. views: as for `read_views`.
    Raises InputError if a camera cannot be used, or a size is neither known nor given.
    """
    if size:
        require_rendering_size(size)
    with unpacked(path) as folder:
        return _read(folder, views, size)


def require_rendering_size(size: tuple[int, int]) -> None:
    """Raise InputError if `size` = (height, width) is outside the limits of renderings."""
    if not all(1 <= side <= LARGEST_SIDE for side in size):
        raise InputError(f"size {size[1]}x{size[0]}: renderings have sides of 1 to {LARGEST_SIDE}; change `size`.")


def resized(cameras: Cameras, image_size: tuple[int, int], size: tuple[int, int]) -> Cameras:
    """Return cameras of images of `image_size` for images cropped to their centre and resized to `size`, both h, w."""
    height, width = image_size
    in_pixels = cameras.intrinsics_px(height, width).tolist()
    pinholes = (Lens(width, height, fx[0], fy[1], fx[2], fy[2]) for fx, fy, _ in in_pixels)
    intrinsics = np.stack([framed_intrinsics(pinhole, size) for pinhole in pinholes])
    return replace(cameras, intrinsics=torch.from_numpy(intrinsics.astype(np.float32)))


def _read(path: Path, views: Selection | None, size: tuple[int, int] | None) -> RenderCameras:
    found = read_camera_path(path) if path.suffix.lower() == ".json" and path.is_file() else None
    scene, frames_per_second = found or (read_cameras(path, are_images_needed=False), None)
    photographs, notes = select_views(scene, views, path, are_images_needed=False)
    pinholes = [known_pinhole(photograph, size) for photograph in photographs]
    if found and not size:
        size = (min(pinholes[0].height, LARGEST_SIDE), min(pinholes[0].width, LARGEST_SIDE))
    image_size = size or common_size(pinholes, [str(photograph.path) for photograph in photographs])
    poses = np.stack([rigid_pose(photograph.camera_to_world, photograph.place) for photograph in photographs])
    require_float32_range(poses, str(scene.cameras_path))
    intrinsics = np.stack([framed_intrinsics(pinhole, image_size) for pinhole in pinholes])
    near, far = known_depth_bounds(scene) or (float("nan"), float("nan"))
    cameras = Cameras.in_float32(poses, intrinsics, near, far)
    names = _distinct(tuple(photograph.path.stem for photograph in photographs))
    return RenderCameras(cameras, image_size, names, not np.isnan(near), frames_per_second, (*scene.remarks, *notes))


def _distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return unique names: if two views share a name (left/a.png, right/a.png), each name gets a number in front."""
    if len(set(names)) == len(names):
        return names
    return tuple(f"{view:02d}_{name}" for view, name in enumerate(names))
