"""Pixels of the frames of a video as they are to be shown: in sRGB, upright, deinterlaced, of square pixels."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from fecocodec.photographs.colour import coded_to_srgb, is_srgb

_LARGEST_ROWS_OF_601 = 576  # a video with more rows that does not state its matrix has that of BT.709
Picture = UInt8[np.ndarray, "height width 3"]


@dataclass(frozen=True)
class Stream:
    """What a video states of all its frames. pixel_aspect: width of a pixel relative to its height.

    primaries, transfer: of its colours, as numbers of ITU-T H.273. has_alpha: by a tag, as WebM has it.
    """

    pixel_aspect: Fraction
    primaries: int
    transfer: int
    has_alpha: bool = False


def side_data(frame: Any, kind: str) -> Any:
    """Return side data of a frame; None if it has none, or also has some of a kind that PyAV does not know (EXIF)."""
    try:
        return frame.side_data.get(kind)
    except ValueError:
        return None


def is_transparent(frame: Any, stream: Stream) -> bool:
    """Return whether a frame has opacity, which is not read."""
    return stream.has_alpha or any(component.is_alpha for component in frame.format.components)


def in_srgb(frame: Any, stream: Stream) -> Picture:
    """Return the pixels of a frame as sRGB."""
    from av.video.reformatter import Colorspace

    states_matrix = int(frame.colorspace) in list(Colorspace)
    matrix = {} if states_matrix or frame.height <= _LARGEST_ROWS_OF_601 else {"src_colorspace": Colorspace.ITU709}
    if is_srgb(stream.primaries, stream.transfer):
        picture: Picture = frame.to_ndarray(format="rgb24", **matrix)
        return picture
    pixels = frame.to_ndarray(format="rgb48le", **matrix) / np.float32(65535)
    coded_to_srgb(pixels, stream.primaries, stream.transfer)
    return np.rint(255 * pixels).astype(np.uint8)


def upright(picture: Picture, stream: Stream, frame: Any) -> UInt8[np.ndarray, "rows columns 3"]:
    """Return the picture as it is to be shown: one field of an interlaced frame, square pixels, the display matrix."""
    height, width = picture.shape[:2]
    field = picture[::2] if frame.interlaced_frame else picture
    shown = (max(1, round(width * stream.pixel_aspect)), height)
    if field.shape[1::-1] != shown:
        field = np.asarray(Image.fromarray(field).resize(shown, Image.Resampling.LANCZOS))
    matrix = side_data(frame, "DISPLAYMATRIX")
    if matrix is None:
        return np.ascontiguousarray(np.rot90(field, round(getattr(frame, "rotation", 0) / 90)))
    a, b, _, c, d = np.frombuffer(matrix, np.int32)[:5].tolist()  # (x, y) is shown at (a x + c y, b x + d y)
    across, down = (a, d) if abs(a) >= abs(b) else (c, b)
    turned = field if abs(a) >= abs(b) else field.swapaxes(0, 1)
    return np.ascontiguousarray(turned[:: -1 if down < 0 else 1, :: -1 if across < 0 else 1])
