"""Convert to sRGB what HEIC, AVIF and PNG files state of their colours without an ICC profile."""

import struct

import numpy as np
from jaxtyping import UInt8, UInt16

from fecocodec.photographs.colour import coded_to_srgb, is_srgb, linear_to_srgb

COLOUR_BYTES = 1 << 16  # of a file, in which it states its colours
Samples = UInt8[np.ndarray, "height width channel"] | UInt16[np.ndarray, "height width channel"]


def stated_to_srgb(samples: Samples, head: bytes, gamma: float | None) -> Samples:
    """Return sRGB samples. head: the first COLOUR_BYTES of the file. gamma: of a PNG whose values are light ** gamma.

    Opacity, the last of two or four channels, stays as it is.
    """
    largest = np.float32(np.iinfo(samples.dtype).max)
    count = samples.shape[2] - (samples.shape[2] + 1) % 2  # without opacity
    stated = coded_colours(head)
    if stated and count == 3 and not is_srgb(*stated):
        pixels = samples[..., :3] / largest
        coded_to_srgb(pixels, *stated)
    elif gamma is not None and not stated:
        pixels = linear_to_srgb((np.arange(largest + 1) / largest) ** (1 / gamma))[samples[..., :count]]
    else:
        return samples
    return np.concatenate((np.rint(largest * pixels).astype(samples.dtype), samples[..., count:]), axis=2)


def coded_colours(head: bytes) -> tuple[int, int] | None:
    """Return primaries and transfer function as numbers of ITU-T H.273; None if the file states none."""
    mark, layout = (b"cICP", ">BB") if head.startswith(b"\x89PNG") else (b"colrnclx", ">HH")
    numbers = head.partition(b"IDAT")[0].partition(mark)[2][: struct.calcsize(layout)]
    if len(numbers) < struct.calcsize(layout):
        return None
    primaries, transfer = struct.unpack(layout, numbers)
    return primaries, transfer
