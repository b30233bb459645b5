"""The EXIF orientation: a number from 1 to 8 that says how stored pixels are to be turned to be shown."""

import numpy as np
from jaxtyping import UInt8, UInt16
from PIL import Image

from fecocodec.photographs.stated_colours import Samples

UPRIGHT, LAST_ORIENTATION = 1, 8
_TURNED_UPRIGHT = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


def turned_upright(image: Image.Image, orientation: int) -> Image.Image:
    """Return the image as an EXIF orientation says that it is to be shown."""
    turn = _TURNED_UPRIGHT.get(orientation)
    return image if turn is None else image.transpose(turn)


def as_stored(
    samples: Samples, orientation: int
) -> UInt8[np.ndarray, "rows columns channel"] | UInt16[np.ndarray, "rows columns channel"]:
    """Return the samples of an image that its decoder turned upright as they are stored."""
    turned = samples.swapaxes(0, 1) if orientation > 4 else samples
    return turned[:: -1 if orientation in (3, 4, 6, 7) else 1, :: -1 if orientation in (2, 3, 7, 8) else 1]
