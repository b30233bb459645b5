"""A folder of photographs with cameras, read into views of one size."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from fecocodec.errors import InputError
from fecocodec.formats.colmap import find_colmap_model, read_colmap
from fecocodec.formats.framing import common_size, crop_and_resize, framed_intrinsics, require_size
from fecocodec.formats.images import read_image
from fecocodec.formats.lens import Lens, undistort
from fecocodec.formats.posed_photographs import PosedPhotograph, PosedPhotographs, stored_lens
from fecocodec.formats.poses import require_float32_range, rigid_pose
from fecocodec.formats.realestate10k import find_realestate10k, read_realestate10k
from fecocodec.formats.transforms_json import find_transforms_json, read_transforms_json
from fecocodec.formats.view_choice import choose_views
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import bounds_of_depths, estimate_depth_range
from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class _Chosen:
    """Photographs of which no pixel is read yet.

    lenses: as stored, and the pinholes they are undistorted to. image_size: (height, width) that all are brought to.
    cameras: for that size, without near and far.
    """

    scene: PosedPhotographs
    photographs: list[PosedPhotograph]
    lenses: list[tuple[Lens, Lens]]
    image_size: tuple[int, int]
    cameras: Cameras

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(photograph.path.name for photograph in self.photographs)


def read_views(
    path: Path,
    *,
    views: tuple[int | str, ...] | None = None,
    size: tuple[int, int] | None = None,
    near: float | None = None,
    far: float | None = None,
) -> Views:
    """Read the views of a scene folder (or of a camera file in it).

    Cameras are looked for as `transforms.json`, then as a COLMAP model (`sparse/0`, `sparse` or the folder itself),
    then as RealEstate10K camera text. Lens distortion is removed. Without `size` all images get the most frequent
    size among them, scaled down where a side is over 1024 pixels; with `size` = (height, width) they are cropped
    around the centre to that shape and resized.
    views: which ones, see `choose_views`. near, far: bounds of depth in scene units; where missing, those of the
    camera file, else of its sparse points, else estimated from the images (`estimate_depth_range`).
    Raises InputError where the folder, a camera or an image cannot be used.
    """
    chosen = _choose(path, views, size)
    unbounded = _read_unbounded(chosen)
    cameras = _with_depth_bounds(chosen, near, far, partial(estimate_depth_range, unbounded))
    return replace(unbounded, cameras=cameras)


def read_view_cameras(
    path: Path, *, views: tuple[int | str, ...] | None = None, size: tuple[int, int] | None = None
) -> tuple[Cameras, tuple[int, int], tuple[str, ...]]:
    """The cameras, (height, width) and names of what `read_views` returns.

    Pixels are read only where neither the camera file nor its sparse points tell the depth bounds.
    Raises InputError as `read_views` does.
    """
    chosen = _choose(path, views, size)
    cameras = _with_depth_bounds(chosen, None, None, lambda: estimate_depth_range(_read_unbounded(chosen)))
    return cameras, chosen.image_size, chosen.names


def view_names(path: Path) -> tuple[str, ...]:
    """File names of all views that a scene folder has cameras for, in the order `--views` counts them.

    Raises InputError as `read_views` does for its cameras; images are not looked at.
    """
    return tuple(photograph.path.name for photograph in read_cameras(path).photographs)


def read_cameras(path: Path) -> PosedPhotographs:
    """The cameras of a scene folder, or of a camera file given itself, in the first format found."""
    try:
        scene = _find_cameras(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions.") from error
    if scene is None and path.is_file():
        raise InputError(f"{path}: not a camera file; give the folder that holds images and cameras.")
    if scene is None:
        raise InputError(
            f"{path}: no cameras found; add a transforms.json, a COLMAP model in sparse/0 or a RealEstate10K camera "
            "file."
        )
    return scene


def _find_cameras(path: Path) -> PosedPhotographs | None:
    if not path.exists():
        raise InputError(f"{path}: no such folder; give the folder that holds images and cameras.")
    if transforms := find_transforms_json(path):
        return read_transforms_json(transforms)
    if model := find_colmap_model(path):
        return read_colmap(path, model)
    if camera_text := find_realestate10k(path):
        return read_realestate10k(camera_text)
    return None


def _choose(path: Path, views: tuple[int | str, ...] | None, size: tuple[int, int] | None) -> _Chosen:
    """Poses, lenses and sizes from the camera file and the headers of the images."""
    if size:
        require_size(size)
    scene = read_cameras(path)
    photographs = choose_views(scene.photographs, views, path)
    poses = np.stack([rigid_pose(photograph.camera_to_world, photograph.place) for photograph in photographs])
    require_float32_range(poses, str(scene.cameras_path))
    lenses = [stored_lens(photograph) for photograph in photographs]
    pinholes = [pinhole for _, pinhole in lenses]
    common = size or common_size(pinholes, [str(photograph.path) for photograph in photographs])
    intrinsics = np.stack([framed_intrinsics(pinhole, common) for pinhole in pinholes])
    cameras = Cameras(
        extrinsics=torch.from_numpy(poses.astype(np.float32)),
        intrinsics=torch.from_numpy(intrinsics.astype(np.float32)),
        near=torch.tensor(torch.nan),
        far=torch.tensor(torch.nan),
    )
    return _Chosen(scene, photographs, lenses, common, cameras)


def _read_unbounded(chosen: _Chosen) -> Views:
    """Undistorted images of one size; near and far are not known yet."""
    images = [
        crop_and_resize(undistort(read_image(photograph.path), lens, pinhole), pinhole, chosen.image_size)[0]
        for photograph, (lens, pinhole) in zip(chosen.photographs, chosen.lenses, strict=True)
    ]
    return Views(torch.stack(images), chosen.cameras, chosen.names)


def _with_depth_bounds(
    chosen: _Chosen, near: float | None, far: float | None, estimate: Callable[[], tuple[float, float]]
) -> Cameras:
    """The cameras with bounds that are given, stated, known from sparse points, or else estimated."""
    scene = chosen.scene
    near = scene.near if near is None else near
    far = scene.far if far is None else far
    if near is None or far is None:
        sparse_depths = np.concatenate([photograph.sparse_depths for photograph in chosen.photographs])
        known = bounds_of_depths(torch.from_numpy(sparse_depths)) or estimate()
        near, far = known[0] if near is None else near, known[1] if far is None else far
    if not 0 < near < far < torch.finfo(torch.float32).max:
        raise InputError(
            f"{scene.cameras_path}: near {near:.6g} and far {far:.6g} are no range of depths; "
            "0 < near < far is needed, set them with --near and --far."
        )
    bounds = {"near": torch.tensor(near, dtype=torch.float32), "far": torch.tensor(far, dtype=torch.float32)}
    return replace(chosen.cameras, **bounds)
