"""Read a folder of photographs with cameras as views of one size."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, distinct_names
from fecocodec.captures.archives import unpacked
from fecocodec.captures.chosen_photographs import ChosenPhotographs, choose_photographs
from fecocodec.captures.reading_notes import light_remarks, mask_remarks, omission_notes, unmasked_remarks
from fecocodec.captures.view_selection import Selection
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.coding_grid import LEAST_KEPT, filled
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.geometry.depth_range import believable_bounds, estimate_depth_range
from fecocodec.geometry.views import Views, joined, joined_planes
from fecocodec.input_file import StrPath
from fecocodec.limits import require_depths
from fecocodec.photographs.exr import Photograph
from fecocodec.photographs.images import LEVELS, Background, read_photograph
from fecocodec.photographs.lens import Lens
from fecocodec.photographs.masks import cut_out, find_mask, read_mask
from fecocodec.photographs.resampling import crop_and_resize, undistort

Masks = Literal["leave-out", "cut-out", "unused"]


def read_views(
    path: StrPath,
    *,
    views: Selection | None = None,
    size: tuple[int, int] | None = None,
    near: float | None = None,
    far: float | None = None,
    background: Background | None = None,
    masks: Masks = "leave-out",
) -> Views:
    """Read the views of a scene folder (or of a camera file in it, or of a ZIP archive of it).

    The search order for cameras is `transforms.json`, a COLMAP model (`sparse/0`, `sparse` or the folder itself),
    RealEstate10K camera text, `cameras.json` of 3DGS, `poses_bounds.npy` of LLFF. Lens distortion is removed. All
    images are centre-cropped and resized to `size` = (height, width). The default is the most frequent size, scaled
    down if a side exceeds 1024 pixels. `notes` of the result lists effects that the caller may not expect.
    views: indices and names, see `choose_views`, or `Spread`, `Auto` or `All`; None selects all views, or `Auto` if
    there are more than 16. Views that cannot be used, or whose image is missing, are passed over unless they are named.
    near, far: bounds of depth in scene units. The defaults are those of the camera file, unless matching contradicts
    them, else of its sparse points, else estimated from the images (`estimate_depth_range`).
    background: colour on which transparent images are composited; `alpha` of the result is then None. By default the
    background is white, and `alpha` is their opacity.
    masks: what becomes of the pixels that masks mark (`mask_path` in a `transforms.json`, or a folder `masks`): they
    are `ignored` in the result, and filled from around them ("leave-out"), or transparent ("cut-out"), or nothing
    ("unused").
    Raises InputError if the folder, a camera or an image cannot be used.
    """
    with unpacked(path) as folder:
        chosen = choose_photographs(folder, views=views, size=size)
        read = with_depth_bounds(chosen, read_unbounded(chosen, background, masks), near, far)
        return replace(read, remarks=(*chosen.remarks, *read.remarks))


def read_others(
    chosen: ChosenPhotographs,
    *,
    background: Background | None = None,
    masks: Masks = "leave-out",
    on_left_out: Callable[[str], None] | None = None,
) -> Views | None:
    """Read photographs that are not coded; near and far of their cameras are NaN. Returns None if none is left.

    on_left_out: called with a sentence for each cause for which photographs cannot be read; None raises InputError.
    """
    read, problems = list[Views](), dict[int, str]()
    for index in range(len(chosen.names)):
        try:
            read.append(read_unbounded(chosen.select([index]), background, masks))
        except InputError as error:
            if on_left_out is None:
                raise
            problems[index] = str(error)
    for sentence in omission_notes(chosen.photographs, chosen.names, problems):
        if on_left_out is not None:
            on_left_out(sentence)
    return joined(read) if read else None


def read_readable(chosen: ChosenPhotographs, indices: list[int], masks: Masks) -> tuple[Views | None, list[int]]:
    """Read those of the photographs that can be read, on white, and return their indices. indices: of all chosen."""
    views = read_others(chosen, background="white", masks=masks, on_left_out=lambda _sentence: None)
    names = () if views is None else views.names
    return views, [index for name, index in zip(chosen.names, indices, strict=True) if name in names]


def with_problems(scene: PosedPhotographs, indices: list[int], on_left_out: Callable[[str], None]) -> PosedPhotographs:
    """Return the scene with the problem of each of these photographs that cannot be read; the same one if all can.

    on_left_out: as for `read_others`.
    """
    problems = dict[int, str]()
    for index in indices:
        try:
            read_photograph(scene.photographs[index].path)
        except InputError as error:
            problems[index] = str(error)
    if not problems:
        return scene
    names = distinct_names([photograph.path for photograph in scene.photographs])
    for sentence in omission_notes(scene.photographs, names, problems):
        on_left_out(sentence)
    photographs = [
        replace(photograph, problem=problems[index], is_told=True) if index in problems else photograph
        for index, photograph in enumerate(scene.photographs)
    ]
    return replace(scene, photographs=photographs)


def read_unbounded(chosen: ChosenPhotographs, background: Background | None, masks: Masks) -> Views:
    """Read undistorted images of one size; near and far of the cameras are NaN."""
    read = [
        _framed_pixels(photograph, lenses, chosen.image_size, background or "white", masks)
        for photograph, lenses in zip(chosen.photographs, chosen.lenses, strict=True)
    ]
    cameras = Cameras.in_float32(chosen.extrinsics, chosen.intrinsics, torch.nan, torch.nan)
    shape = chosen.image_size
    ignored = _stacked([one.ignored for one in read], torch.zeros(shape, dtype=torch.bool))
    return Views(
        images=filled(torch.stack([one.colour for one in read]), ignored),
        cameras=cameras,
        names=chosen.names,
        alpha=None if background is not None else _stacked([one.alpha for one in read], torch.ones(shape)),
        notes=chosen.notes,
        ignored=ignored,
        remarks=(
            *light_remarks(chosen.names, [one.clipped for one in read], [one.blackened for one in read]),
            *mask_remarks([one.masked for one in read if one.masked is not None], masks),
            *(unmasked_remarks(chosen.photographs, masks) if masks != "unused" else []),
        ),
    )


def _stacked(planes: list[Tensor | None], otherwise: Tensor) -> Tensor | None:
    """Return the planes of all views, with `otherwise` for those without; None if all are without."""
    return joined_planes([(None if plane is None else plane[None], otherwise[None]) for plane in planes])


@dataclass(frozen=True)
class _Framed(Photograph):
    """One view. ignored: pixels to leave out. masked: share of the stored pixels that its mask marks. None for none."""

    ignored: Bool[Tensor, "height width"] | None = None
    masked: float | None = None


def _framed_pixels(
    photograph: PosedPhotograph,
    lenses: tuple[Lens, Lens],
    image_size: tuple[int, int],
    background: Background,
    masks: Masks,
) -> _Framed:
    """Read a photograph and its mask; undistort, crop and resize to `image_size`."""
    stored = read_photograph(photograph.path, background)
    colour, alpha = stored.colour, stored.alpha
    mask = None if masks == "unused" else photograph.mask or find_mask(photograph.path)
    black = None if mask is None else read_mask(mask, *colour.shape[1:])
    black = black if black is not None and bool(black.any()) else None
    if black is not None and masks == "cut-out":
        colour, alpha = cut_out(colour, alpha, black, LEVELS[background])
    is_left_out = black is not None and masks == "leave-out"
    if black is not None and is_left_out and bool(black.all()):
        raise InputError(
            f"{mask}: the mask marks every pixel of {photograph.path.name}; correct it, or leave both out."
        )
    planes = [colour, *(alpha[None] for alpha in (alpha,) if alpha is not None)]
    planes += [(~black)[None].float()] if black is not None and is_left_out else []
    lens, pinhole = lenses
    framed = crop_and_resize(undistort(torch.cat(planes), lens, pinhole), pinhole, image_size)[0]
    return _Framed(
        colour=framed[:3],
        alpha=None if alpha is None else framed[3],
        ignored=framed[-1] < LEAST_KEPT if is_left_out else None,
        clipped=stored.clipped,
        blackened=stored.blackened,
        masked=None if black is None else black.float().mean().item(),
    )


def with_depth_bounds(
    chosen: ChosenPhotographs, views: Views, near: float | None, far: float | None, guides: Views | None = None
) -> Views:
    """Return the views with depth bounds from the arguments, the camera file, sparse points, or else an estimate.

    Those of the camera file are corrected if matching contradicts them (`believable_bounds`). views: as read, of these
    photographs. guides: other photographs, which an estimate uses too. Raises InputError for bounds that are no range.
    """
    scene, is_chosen = chosen.scene, near is not None or far is not None
    # Bounds that were both given are no fault of the camera file.
    place = f"{scene.cameras_path}: " if near is None or far is None else ""
    near = scene.near if near is None else near
    far = scene.far if far is None else far
    is_stated = near is not None and far is not None
    if near is None or far is None:
        sparse_depths = np.concatenate([photograph.sparse_depths for photograph in chosen.photographs])
        known = bounds_of_depths(sparse_depths) or estimate_depth_range(views, guides)
        near, far = known[0] if near is None else near, known[1] if far is None else far
    require_depths(near, far, place)
    views = views.within(near, far)
    if is_chosen or not is_stated or (bounds := believable_bounds(views, guides)) is None:
        return views
    remark = (
        f"{place}near and far are {near:.3g} and {far:.3g}, but matching finds the scene between "
        f"{bounds[0]:.3g} and {bounds[1]:.3g}, which are used; `near` and `far` set others."
    )
    return replace(views.within(*bounds), remarks=(*views.remarks, remark))
