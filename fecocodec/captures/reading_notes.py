"""Notes on results of `read_views` that the user may not expect, one sentence each."""

import filecmp
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, distinct_names
from fecocodec.errors import some_of
from fecocodec.input_file import first_bytes
from fecocodec.limits import MAX_SIDE
from fecocodec.photographs.framing import kept_share, most_pixels
from fecocodec.photographs.image_headers import has_image_name, is_exr, is_upright, maps_among
from fecocodec.photographs.lens import Lens
from fecocodec.photographs.pillow_images import gamma_with_pillow, has_several_pictures

LEAST_KEPT_SHARE = 0.75  # of a photograph's area, after the centre crop
_EQUAL_SHARE = 0.005  # smaller differences are not told
LARGEST_FOCAL = 2.5  # in image sides; a field of view of 23 degrees
LARGEST_FOCAL_WITHOUT_SIZE = 1.5  # 37 degrees; twice the focal length of a phone exceeds it
MOST_NAMED = 20  # photographs in one note
_BEGINNING_BYTES = 1 << 14  # of files that are compared as a whole only if these are equal


def framing_notes(lenses: list[tuple[Lens, Lens]], names: list[str], size: tuple[int, int]) -> list[str]:
    """Return notes on mixed sizes or orientations and on large crops. lenses, size: as in `ChosenPhotographs`."""
    notes = []
    sizes = Counter((lens.width, lens.height) for lens, _ in lenses)
    if len(sizes) > 1:
        found = ", ".join(f"{count} of {width}x{height}" for (width, height), count in sizes.most_common(4))
        kind = "orientations" if len({width > height for width, height in sizes}) > 1 else "sizes"
        notes.append(
            f"the photographs have several {kind} ({found}); all are cropped and resized to "
            f"{size[1]}x{size[0]}; choose photographs of one size by `views`."
        )
    shares = [kept_share(pinhole, size) for _, pinhole in lenses]
    least = min(shares)
    if least < LEAST_KEPT_SHARE:
        worst = shares.index(least)
        lens, _ = lenses[worst]
        alike = sum(share < least + _EQUAL_SHARE for share in shares) - 1
        others = f" and of {alike} other{'' if alike == 1 else 's'}" if alike else ""
        notes.append(
            f"the crop to {size[1]}x{size[0]} leaves {100 * least:.0f}% of {names[worst]} "
            f"({lens.width}x{lens.height}){others}; choose a `size` of the photographs' shape to keep more."
        )
    return notes


def passed_over_notes(scene: PosedPhotographs, usable: list[PosedPhotograph]) -> list[str]:
    """Return a note on images that are missing, and one for each cause for which cameras cannot be used."""
    used = {id(photograph) for photograph in usable}
    names: dict[str, list[str]] = {}
    for photograph in scene.photographs:
        if id(photograph) not in used and not photograph.is_told:
            names.setdefault(photograph.cause, []).append(photograph.name or photograph.place.split(", ")[-1])
    return [_passed_over(scene, cause, of_cause) for cause, of_cause in names.items()]


def _passed_over(scene: PosedPhotographs, cause: str, names: list[str]) -> str:
    count = f"{len(names)} of {len(scene.photographs)}"
    is_one = len(names) == 1
    if not cause:
        are = "is missing and is" if is_one else "are missing and are"
        return (
            f"{count} images that {scene.cameras_name} names {are} passed over ({some_of(names, MOST_NAMED)}); put "
            f"{'it' if is_one else 'them'} there to use {'it' if is_one else 'them'}."
        )
    are = "is" if is_one else "are"
    return f"{count} cameras of {scene.cameras_name} {are} passed over ({some_of(names, MOST_NAMED)}): {cause}"


def omission_notes(
    photographs: Sequence[PosedPhotograph], names: Sequence[str], problems: Mapping[int, str]
) -> tuple[str, ...]:
    """Return a sentence for each cause for which photographs cannot be used, with their names.

    names: of all photographs. problems: messages of errors, by the index of the photograph.
    """
    names_of: dict[str, list[str]] = {}
    for index, problem in problems.items():
        cause = problem.removeprefix(f"{photographs[index].path}: ").removeprefix(photographs[index].place)
        names_of.setdefault(cause.lstrip(":, "), []).append(names[index])
    return tuple(
        f"{some_of(named, MOST_NAMED)} {'is' if len(named) == 1 else 'are'} left out: {cause}"
        for cause, named in names_of.items()
    )


def unposed_notes(scene: PosedPhotographs) -> list[str]:
    """Return a note if images beside the photographs of a scene have no camera."""
    posed = {Path(os.path.abspath(photograph.path)) for photograph in scene.photographs}
    elsewhere = {Path(os.path.abspath(path)) for path in scene.posed_elsewhere}  # a remark tells of their cameras
    folders = sorted({path.parent for path in posed})
    beside = [path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())]
    images = [path for path in beside if has_image_name(path)]
    named = {Path(os.path.abspath(photograph.mask)) for photograph in scene.photographs if photograph.mask}
    found = [path.name for path in images if path not in {*posed, *elsewhere, *named, *maps_among(images)}]
    if not found:
        return []
    has, used = ("has", "is not used") if len(found) == 1 else ("have", "are not used")
    return [
        f"{some_of(found)} {has} no camera in {scene.cameras_name} and {used}; add one for each, or choose by `views`."
    ]


def without_copies(photographs: list[PosedPhotograph]) -> tuple[list[PosedPhotograph], list[str]]:
    """Leave out photographs whose files have equal bytes, but the first; return the others and a note for each."""
    kept: dict[bytes, list[PosedPhotograph]] = {}
    notes = []
    for photograph in photographs:
        alike = kept.setdefault(first_bytes(photograph.path, _BEGINNING_BYTES), [])
        original = next((other for other in alike if _are_equal(other.path, photograph.path)), None)
        if original is None:
            alike.append(photograph)
        else:
            shown, of = distinct_names([photograph.path, original.path])
            notes.append(f"{shown} is left out: it is a copy of {of}; remove it, or choose both by `views`.")
    first = {id(photograph) for alike in kept.values() for photograph in alike}
    return [photograph for photograph in photographs if id(photograph) in first], notes


def _are_equal(one: Path, other: Path) -> bool:
    try:
        return filecmp.cmp(one, other, shallow=False)
    except OSError:
        return False


def picture_remarks(paths: list[Path]) -> list[str]:
    """Return sentences on what is read of files: the first picture, a gamma of PNG, a layer of OpenEXR."""
    exr = [path for path in paths if is_exr(path)]
    others = [path for path in paths if path not in exr]
    gammas = Counter(gamma_with_pillow(path) for path in others)
    remarks = [
        f"{_photographs(count)} {'is' if count == 1 else 'are'} converted to sRGB from the values of gamma {gamma:g} "
        f"that a gAMA chunk states{', which is linear light' if gamma == 1 else ''}; store them without it if it is "
        "wrong."
        for gamma, count in gammas.items()
        if gamma
    ]
    if several := [path.name for path in others if has_several_pictures(path)]:
        remarks.append(
            f"{some_of(several)} {'holds' if len(several) == 1 else 'hold'} several pictures; the first is used."
        )
    if not exr:
        return remarks
    from fecocodec.photographs.exr import colour_layer  # it loads torch

    layers = Counter(colour_layer(path) for path in exr)
    return [
        *remarks,
        *(
            f"the colours of {_photographs(count)} are those of the layer {layer}."
            for layer, count in layers.items()
            if layer
        ),
    ]


def light_remarks(names: tuple[str, ...], clipped: list[float], blackened: list[float]) -> list[str]:
    """Return sentences if values were changed. clipped, blackened: share of the pixels of each photograph."""
    kinds = (
        (clipped, "light above 1, which is clipped to 1", "store them darker to keep it"),
        (blackened, "values that are NaN or negative, which become 0", "store them again without"),
    )
    counts = [sum(share > 0 for share in shares) for shares, *_ in kinds]
    return [
        f"{_photographs(count)} {'has' if count == 1 else 'have'} {what} (at most {100 * max(shares):.2g}% of the "
        f"pixels, of {names[shares.index(max(shares))]}); {remedy}."
        for count, (shares, what, remedy) in zip(counts, kinds, strict=True)
        if count
    ]


def mask_remarks(ignored: list[float], masks: str) -> list[str]:
    """Return a sentence on masks. ignored: share of the pixels that the mask of each masked photograph marks."""
    if not ignored:
        return []
    become = "become transparent" if masks == "cut-out" else "are left out"
    return [
        f"masks of {_photographs(len(ignored))} mark {100 * np.mean(ignored):.2g}% of their pixels, which {become}."
    ]


def unmasked_remarks(photographs: list[PosedPhotograph], masks: str) -> list[str]:
    """Return a sentence if photographs have no mask: in a folder of masks, where they are read, or to cut out."""
    from fecocodec.photographs.masks import find_mask, mask_folders, unread_mask  # it loads torch

    without = [photograph.path for photograph in photographs if not (photograph.mask or find_mask(photograph.path))]
    if found := [(path, folder) for path in without for _, folder in mask_folders(path)]:
        path, folder = found[0]
        count = _photographs(len(without))
        return [f"{folder} has no mask for {count}, such as {path.name}; name a mask {path.name}.png."]
    remedy = "put masks into a folder masks beside that of the photographs"
    if unread := next(filter(None, map(unread_mask, without)), None):
        return [f"{unread} is a mask by its name or folder, and is not read; {remedy}."]
    if masks == "cut-out" and len(without) == len(photographs):
        return [f"no photograph has a mask to cut it out by; {remedy}."]
    return []


def _photographs(count: int) -> str:
    return f"{count} photograph" + ("" if count == 1 else "s")


def scaling_remark(lenses: list[tuple[Lens, Lens]], size: tuple[int, int]) -> str | None:
    """Return a sentence if photographs are scaled down, None otherwise. lenses, size: as for `framing_notes`."""
    sizes = Counter((pinhole.width, pinhole.height, lens.width, lens.height) for lens, pinhole in lenses)
    width, height, *stored = sizes.most_common(1)[0][0]
    if (height, width) == size:
        return None
    reason = f"no side may exceed {MAX_SIDE} pixels"
    if max(size) < min(MAX_SIDE, max(width, height)):
        count = len(lenses)
        reason = f"{count} coded views have at most {most_pixels(count):,} pixels together unless `size` is given"
    return f"photographs of {stored[0]}x{stored[1]} are coded at {size[1]}x{size[0]}; {reason}."


def orientation_notes(paths: list[Path]) -> list[str]:
    """Return a note if the EXIF orientation of a photograph is not upright."""
    turned = [path.name for path in paths if not is_upright(path)]
    if not turned:
        return []
    what = f"{turned[0]} has" if len(turned) == 1 else f"{len(turned)} photographs, such as {turned[0]}, have"
    return [
        f"{what} an EXIF orientation, which is not applied, because cameras refer to the pixels as stored; if yours "
        "refer to the upright photographs, store these upright."
    ]


def lens_notes(pinholes: list[Lens], names: list[str], sizes: list[tuple[int, int] | None]) -> list[str]:
    """Return a note if a focal length in pixels seems to refer to a larger image than the stored one.

    sizes: image sizes that the camera file states, None where it states none and the focal length is thus ambiguous.
    """
    suspects = [
        (lens, name)
        for lens, name, size in zip(pinholes, names, sizes, strict=True)
        if lens.fx / max(lens.width, lens.height) > (LARGEST_FOCAL if size else LARGEST_FOCAL_WITHOUT_SIZE)
    ]
    if not suspects:
        return []
    lens, name = max(suspects, key=lambda suspect: suspect[0].fx / max(suspect[0].width, suspect[0].height))
    return [
        f"the focal length of {name} is {lens.fx:.0f} pixels for an image of {lens.width}x{lens.height}, a narrow "
        "field of view; if the image was reduced after its camera was computed, give the camera file the size (w, h) "
        "that fl_x is for."
    ]
