"""Read a folder of photographs with cameras as views of one size."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.formats.camera_files import read_cameras
from fecocodec.formats.framing import common_size, crop_and_resize, framed_intrinsics, require_size
from fecocodec.formats.images import Background, read_image_and_alpha
from fecocodec.formats.input_file import StrPath
from fecocodec.formats.lens import Lens, undistort
from fecocodec.formats.posed_photographs import PosedPhotograph, PosedPhotographs, stored_lens
from fecocodec.formats.poses import require_float32_range, rigid_pose
from fecocodec.formats.reading_notes import framing_notes, lens_notes
from fecocodec.formats.view_choice import choose_views
from fecocodec.formats.view_spread import auto_views
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import bounds_of_depths, estimate_depth_range
from fecocodec.geometry.views import Views
from fecocodec.limits import MAX_VIEWS


@dataclass(frozen=True)
class _Chosen:
    """Chosen photographs, before their pixels are read.

    lenses: of the stored images, and the pinholes to which they are undistorted. image_size: common (height, width).
    cameras: for that size; near and far are NaN. notes: see `Views`.
    """

    scene: PosedPhotographs
    photographs: list[PosedPhotograph]
    lenses: list[tuple[Lens, Lens]]
    image_size: tuple[int, int]
    cameras: Cameras
    notes: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(photograph.path.name for photograph in self.photographs)


def read_views(
    path: StrPath,
    *,
    views: tuple[int | str, ...] | None = None,
    size: tuple[int, int] | None = None,
    near: float | None = None,
    far: float | None = None,
    background: Background | None = None,
) -> Views:
    """Read the views of a scene folder (or of a camera file in it).

    The search order for cameras is `transforms.json`, a COLMAP model (`sparse/0`, `sparse` or the folder itself),
    RealEstate10K camera text. Lens distortion is removed. All images are centre-cropped and resized to `size` =
    (height, width). The default is the most frequent size, scaled down if a side exceeds 1024 pixels. `notes` of the
    result lists effects that the caller may not expect.
    views: see `choose_views`; None selects all views, or `auto_views` if there are more than 16.
    near, far: bounds of depth in scene units. The defaults are those of the camera file, else of its sparse points,
    else estimated from the images (`estimate_depth_range`).
    background: colour on which transparent images are composited; `alpha` of the result is then None. By default the
    background is white, and `alpha` is their opacity.
    Raises InputError if the folder, a camera or an image cannot be used.
    """
    chosen = _choose(Path(path), views, size)
    unbounded = _read_unbounded(chosen, background or "white")
    if background is not None:
        unbounded = replace(unbounded, alpha=None)
    cameras = _with_depth_bounds(chosen, near, far, partial(estimate_depth_range, unbounded))
    return replace(unbounded, cameras=cameras)


def view_names(path: StrPath) -> tuple[str, ...]:
    """Return the file names of all views of a scene folder, in the order of their indices. Images are not read.

    Raises InputError, as `read_views` does, if the cameras cannot be read.
    """
    return tuple(photograph.path.name for photograph in read_cameras(path).photographs)


def _choose(path: Path, views: tuple[int | str, ...] | None, size: tuple[int, int] | None) -> _Chosen:
    """Read poses, lenses and sizes from the camera file and the headers of the images."""
    if size:
        require_size(size)
    scene = read_cameras(path)
    photographs, notes = _chosen_photographs(scene, views, path)
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
    names = [photograph.path.name for photograph in photographs]
    notes += [*lens_notes(pinholes, names), *framing_notes(pinholes, names, common)]
    return _Chosen(scene, photographs, lenses, common, cameras, tuple(notes))


def _chosen_photographs(
    scene: PosedPhotographs, views: tuple[int | str, ...] | None, path: Path
) -> tuple[list[PosedPhotograph], list[str]]:
    """Return the photographs to read, and a note if they were chosen automatically."""
    if views is not None:
        return choose_views(scene.photographs, views, path), []
    if len(scene.photographs) <= MAX_VIEWS:
        return scene.photographs, []
    photographs = [scene.photographs[index] for index in auto_views(scene)]
    names = ", ".join(photograph.path.name for photograph in photographs)
    note = f"{len(photographs)} of {len(scene.photographs)} photographs are used ({names}); choose others by `views`."
    return photographs, [note]


def _read_unbounded(chosen: _Chosen, background: Background = "white") -> Views:
    """Read undistorted images of one size; near and far of the cameras are NaN."""
    pixels = [
        _framed_pixels(photograph.path, lenses, chosen.image_size, background)
        for photograph, lenses in zip(chosen.photographs, chosen.lenses, strict=True)
    ]
    has_alpha = any(len(channels) == 4 for channels in pixels)
    opaque = torch.ones(1, *chosen.image_size)
    alpha = torch.cat([channels[3:] if len(channels) == 4 else opaque for channels in pixels]) if has_alpha else None
    images = torch.stack([channels[:3] for channels in pixels])
    return Views(images, chosen.cameras, chosen.names, alpha, chosen.notes)


def _framed_pixels(
    path: Path, lenses: tuple[Lens, Lens], image_size: tuple[int, int], background: Background
) -> Float[Tensor, "channel height width"]:
    """Read colour, and opacity as a fourth channel if present; undistort, crop and resize to `image_size`."""
    colour, alpha = read_image_and_alpha(path, background)
    pixels = colour if alpha is None else torch.cat((colour, alpha[None]))
    lens, pinhole = lenses
    return crop_and_resize(undistort(pixels, lens, pinhole), pinhole, image_size)[0]


def _with_depth_bounds(
    chosen: _Chosen, near: float | None, far: float | None, estimate: Callable[[], tuple[float, float]]
) -> Cameras:
    """Return the cameras with depth bounds from the arguments, the camera file, sparse points, or else an estimate."""
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
            "0 < near < far is needed, set them with `near` and `far`."
        )
    bounds = {"near": torch.tensor(near, dtype=torch.float32), "far": torch.tensor(far, dtype=torch.float32)}
    return replace(chosen.cameras, **bounds)
