"""A folder of photographs with cameras, read into views of one size."""

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
    """Photographs of which no pixel is read yet.

    lenses: as stored, and the pinholes they are undistorted to. image_size: (height, width) that all are brought to.
    cameras: for that size, without near and far. notes: as of `Views`.
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

    Cameras are looked for as `transforms.json`, then as a COLMAP model (`sparse/0`, `sparse` or the folder itself),
    then as RealEstate10K camera text. Lens distortion is removed. Without `size` all images get the most frequent
    size among them, scaled down where a side is over 1024 pixels; with `size` = (height, width) they are cropped
    around the centre to that shape and resized. `notes` of the result says what the caller may not expect of this.
    views: which ones, see `choose_views`; None for all, or for `auto_views` where there are more than 16.
    near, far: bounds of depth in scene units; where missing, those of the camera file, else of its sparse points, else
    estimated from the images (`estimate_depth_range`).
    background: transparent images are composited on this colour, and `alpha` of the result is None. By default they are
    composited on white, and `alpha` holds their opacity.
    Raises InputError where the folder, a camera or an image cannot be used.
    """
    chosen = _choose(Path(path), views, size)
    unbounded = _read_unbounded(chosen, background or "white")
    if background is not None:
        unbounded = replace(unbounded, alpha=None)
    cameras = _with_depth_bounds(chosen, near, far, partial(estimate_depth_range, unbounded))
    return replace(unbounded, cameras=cameras)


def read_view_cameras(
    path: StrPath, *, views: tuple[int | str, ...] | None = None, size: tuple[int, int] | None = None
) -> tuple[Cameras, tuple[int, int], tuple[str, ...]]:
    """The cameras, (height, width) and names of what `read_views` returns.

    Pixels are read only where neither the camera file nor its sparse points give the depth bounds.
    Raises InputError as `read_views` does.
    """
    chosen = _choose(Path(path), views, size)
    cameras = _with_depth_bounds(chosen, None, None, lambda: estimate_depth_range(_read_unbounded(chosen)))
    return cameras, chosen.image_size, chosen.names


def view_names(path: StrPath) -> tuple[str, ...]:
    """Return the file names of all views that a scene folder has cameras for, in the order that indices count them.

    Raises InputError as `read_views` does for its cameras; images are not looked at.
    """
    return tuple(photograph.path.name for photograph in read_cameras(path).photographs)


def _choose(path: Path, views: tuple[int | str, ...] | None, size: tuple[int, int] | None) -> _Chosen:
    """Poses, lenses and sizes from the camera file and the headers of the images."""
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
    """The photographs to read, and a note where the choice was made here."""
    if views is not None:
        return choose_views(scene.photographs, views, path), []
    if len(scene.photographs) <= MAX_VIEWS:
        return scene.photographs, []
    photographs = [scene.photographs[index] for index in auto_views(scene)]
    names = ", ".join(photograph.path.name for photograph in photographs)
    note = f"{len(photographs)} of {len(scene.photographs)} photographs are used ({names}); choose others by `views`."
    return photographs, [note]


def _read_unbounded(chosen: _Chosen, background: Background = "white") -> Views:
    """Undistorted images of one size; near and far are not known yet."""
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
    """Colour, and opacity as a fourth channel where the image has it, undistorted and brought to `image_size`."""
    colour, alpha = read_image_and_alpha(path, background)
    pixels = colour if alpha is None else torch.cat((colour, alpha[None]))
    lens, pinhole = lenses
    return crop_and_resize(undistort(pixels, lens, pinhole), pinhole, image_size)[0]


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
            "0 < near < far is needed, set them with `near` and `far`."
        )
    bounds = {"near": torch.tensor(near, dtype=torch.float32), "far": torch.tensor(far, dtype=torch.float32)}
    return replace(chosen.cameras, **bounds)
