"""Read a folder of photographs with cameras as views of one size."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.captures.chosen_photographs import ChosenPhotographs, choose_photographs
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.geometry.depth_range import estimate_depth_range
from fecocodec.geometry.views import Views, joined
from fecocodec.input_file import StrPath
from fecocodec.photographs.images import Background, read_image_and_alpha
from fecocodec.photographs.lens import Lens
from fecocodec.photographs.resampling import crop_and_resize, undistort


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
    return read_pixels(choose_photographs(path, views=views, size=size), near=near, far=far, background=background)


def read_pixels(
    chosen: ChosenPhotographs,
    *,
    near: float | None = None,
    far: float | None = None,
    background: Background | None = None,
    guides: Views | None = None,
) -> Views:
    """Read the chosen photographs; arguments and errors as for `read_views`.

    guides: other photographs, from which an estimate of `near` and `far` is made as well.
    """
    unbounded = _read_unbounded(chosen, background)
    estimate = partial(estimate_depth_range, unbounded, guides)
    return replace(unbounded, cameras=_with_depth_bounds(chosen, unbounded.cameras, near, far, estimate))


def read_others(
    chosen: ChosenPhotographs,
    *,
    background: Background | None = None,
    on_left_out: Callable[[str], None] | None = None,
) -> Views | None:
    """Read photographs that are not coded; near and far of their cameras are NaN. Returns None if none is left.

    on_left_out: called with a sentence for each photograph that cannot be read; None raises InputError.
    """
    read = list[Views]()
    for index, name in enumerate(chosen.names):
        try:
            read.append(_read_unbounded(chosen.select([index]), background))
        except InputError as error:
            if on_left_out is None:
                raise
            on_left_out(f"left out {name}, which cannot be used: {str(error).removesuffix('.')}.")
    return joined(read) if read else None


def _read_unbounded(chosen: ChosenPhotographs, background: Background | None) -> Views:
    """Read undistorted images of one size; near and far of the cameras are NaN."""
    pixels = [
        _framed_pixels(photograph.path, lenses, chosen.image_size, background or "white")
        for photograph, lenses in zip(chosen.photographs, chosen.lenses, strict=True)
    ]
    has_alpha = background is None and any(len(channels) == 4 for channels in pixels)
    opaque = torch.ones(1, *chosen.image_size)
    alpha = torch.cat([channels[3:] if len(channels) == 4 else opaque for channels in pixels]) if has_alpha else None
    images = torch.stack([channels[:3] for channels in pixels])
    cameras = Cameras(
        extrinsics=torch.from_numpy(chosen.extrinsics.astype(np.float32)),
        intrinsics=torch.from_numpy(chosen.intrinsics.astype(np.float32)),
        near=torch.tensor(torch.nan),
        far=torch.tensor(torch.nan),
    )
    return Views(images, cameras, chosen.names, alpha, chosen.notes)


def _framed_pixels(
    path: Path, lenses: tuple[Lens, Lens], image_size: tuple[int, int], background: Background
) -> Float[Tensor, "channel height width"]:
    """Read colour, and opacity as a fourth channel if present; undistort, crop and resize to `image_size`."""
    colour, alpha = read_image_and_alpha(path, background)
    pixels = colour if alpha is None else torch.cat((colour, alpha[None]))
    lens, pinhole = lenses
    return crop_and_resize(undistort(pixels, lens, pinhole), pinhole, image_size)[0]


def _with_depth_bounds(
    chosen: ChosenPhotographs,
    cameras: Cameras,
    near: float | None,
    far: float | None,
    estimate: Callable[[], tuple[float, float]],
) -> Cameras:
    """Return the cameras with depth bounds from the arguments, the camera file, sparse points, or else an estimate."""
    scene = chosen.scene
    # Bounds that were both given are no fault of the camera file.
    place = f"{scene.cameras_path}: " if near is None or far is None else ""
    near = scene.near if near is None else near
    far = scene.far if far is None else far
    if near is None or far is None:
        sparse_depths = np.concatenate([photograph.sparse_depths for photograph in chosen.photographs])
        known = bounds_of_depths(sparse_depths) or estimate()
        near, far = known[0] if near is None else near, known[1] if far is None else far
    if not 0 < near < far < torch.finfo(torch.float32).max:
        raise InputError(
            f"{place}near {near:.6g} and far {far:.6g} are no range of depths; "
            "0 < near < far is needed, set them with `near` and `far`."
        )
    bounds = {"near": torch.tensor(near, dtype=torch.float32), "far": torch.tensor(far, dtype=torch.float32)}
    return replace(cameras, **bounds)
