"""The common size of photographs, and the centre crop of each to that shape. Pixels are not read."""

from collections import Counter

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError
from fecocodec.grid import grid_side
from fecocodec.limits import DEFAULT_MAX_PIXELS, FEW_VIEWS, MANY_VIEWS_MAX_PIXELS, MAX_SIDE, MIN_SIDE
from fecocodec.photographs.lens import Lens

MIN_KEPT_AREA = 0.5  # share of each photograph's area that an automatic crop must keep


def common_size(pinholes: list[Lens], names: list[str], stored: list[Lens] | None = None) -> tuple[int, int]:
    """Return (height, width) for all photographs: the most frequent size, scaled down if a side exceeds MAX_SIDE.

    stored: lenses of the images before undistortion, whose sizes errors name; None for those of `pinholes`.
    Raises InputError if cropping would remove more than half of a photograph, or a side is too short.
    """
    sizes = [(lens.height, lens.width) for lens in pinholes]
    shown = [f"{lens.width}x{lens.height}" for lens in stored or pinholes]
    most_frequent = Counter(sizes).most_common(1)[0][0]  # the first one among equals
    height, width = most_frequent
    usual = shown[sizes.index(most_frequent)]
    for (h, w), name, own in zip(sizes, names, shown, strict=True):
        crop_h, crop_w = _crop_shape(h, w, height, width)
        if crop_h * crop_w < MIN_KEPT_AREA * h * w:
            raise InputError(
                f"{name}: {own} pixels, while the other images are {usual}; choose images of one shape by "
                "`views`, or say with `size` what all are cropped and resized to."
            )
    scale = min(1.0, MAX_SIDE / max(height, width))
    height, width = round(height * scale), round(width * scale)
    if min(height, width) < MIN_SIDE:
        reduced = f", reduced to {width}x{height}" if scale < 1 else ""
        raise InputError(
            f"{names[sizes.index(most_frequent)]}: {usual} pixels{reduced}, but each side must have {MIN_SIDE} to "
            f"{MAX_SIDE}; use larger images or give `size`."
        )
    return height, width


def most_pixels(count: int) -> int:
    """Return how many pixels `count` coded views have together unless the user sets a size."""
    return DEFAULT_MAX_PIXELS if count <= FEW_VIEWS else MANY_VIEWS_MAX_PIXELS


def within_limit(size: tuple[int, int], count: int) -> tuple[int, int]:
    """Return (height, width) of `count` views, scaled down to `most_pixels` together."""
    height, width = size
    limit = most_pixels(count)
    scale = min(1.0, (limit / (count * height * width)) ** 0.5)
    while count * grid_side(round(height * scale)) * grid_side(round(width * scale)) > limit:
        scale *= 0.99
    return max(MIN_SIDE, round(height * scale)), max(MIN_SIDE, round(width * scale))


def kept_share(pinhole: Lens, size: tuple[int, int]) -> float:
    """Return the share of an image's area that the centre crop to the shape of `size` = (height, width) keeps."""
    crop_h, crop_w = _crop_shape(pinhole.height, pinhole.width, *size)
    return crop_h * crop_w / (pinhole.height * pinhole.width)


def framed_intrinsics(pinhole: Lens, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """Return the normalised intrinsics of the result of `crop_and_resize` for an image of the pinhole's size."""
    top, left, crop_h, crop_w = crop(pinhole.height, pinhole.width, size)
    return np.array(
        [
            [pinhole.fx / crop_w, 0, (pinhole.cx - left) / crop_w],
            [0, pinhole.fy / crop_h, (pinhole.cy - top) / crop_h],
            [0, 0, 1],
        ]
    )


def crop(height: int, width: int, size: tuple[int, int]) -> tuple[int, int, float, float]:
    """Return (top, left, height, width) of the centre crop to the shape of `size`."""
    crop_h, crop_w = _crop_shape(height, width, *size)
    return int((height - crop_h) // 2), int((width - crop_w) // 2), crop_h, crop_w


def _crop_shape(height: int, width: int, new_height: int, new_width: int) -> tuple[float, float]:
    """Return (height, width), in fractions of pixels, of the largest rectangle of the new shape inside the old one."""
    scale = min(height / new_height, width / new_width)
    # Rounding errors of the product must not make the crop larger than the photograph.
    return min(new_height * scale, float(height)), min(new_width * scale, float(width))
