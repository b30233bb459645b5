"""Decode PNG images with 16 bits per channel by imagecodecs, the `png16` extra; Pillow keeps only 8 bits of colour."""

from types import ModuleType

import numpy as np
from jaxtyping import UInt16

from fecocodec.errors import InputError, installation

_BIT_DEPTH_AT = 24  # byte of a PNG file: after the signature, and length, type, width and height of IHDR
HEAD_BYTES = _BIT_DEPTH_AT + 1
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def has_sixteen_bits(head: bytes) -> bool:
    """Return whether a file is a PNG with 16 bits per channel. head: its first HEAD_BYTES bytes."""
    return head.startswith(_SIGNATURE) and head[_BIT_DEPTH_AT:HEAD_BYTES] == bytes([16])


def decode_sixteen_bits(
    data: bytes, place: str, profile: bytes | None = None
) -> UInt16[np.ndarray, "height width channel"]:
    """Return the sRGB samples of a PNG with 16 bits: grey, grey and opacity, colour, or colour and opacity.

    A colour that the file declares transparent becomes an opacity of 0. profile: ICC profile of the colours; one that
    is damaged or not of the image's kind changes nothing. The caller must bound the number of pixels.
    Raises InputError, which begins with `place`, if imagecodecs is missing or the image is damaged.
    """
    try:
        import imagecodecs
    except ImportError as error:
        raise InputError(
            f"{place}: a PNG with 16 bits per channel needs the package imagecodecs; run {installation('png16')}, "
            "or store it with 8 bits."
        ) from error
    try:
        samples = imagecodecs.png_decode(data)
    except imagecodecs.PngError as error:
        raise InputError(
            f"{place}: the image is damaged, cut short or not PNG ({error}); store it again or remove it."
        ) from error
    samples = samples.reshape(*samples.shape[:2], -1)
    return _in_srgb(imagecodecs, samples, profile) if profile else samples


def _in_srgb(
    imagecodecs: ModuleType, samples: UInt16[np.ndarray, "height width channel"], profile: bytes
) -> UInt16[np.ndarray, "height width channel"]:
    count = samples.shape[2] - (samples.shape[2] + 1) % 2  # without opacity
    colours = np.ascontiguousarray(samples[..., :count]) if count == 3 else np.ascontiguousarray(samples[..., 0])
    space = "rgb" if count == 3 else "gray"
    try:
        converted = imagecodecs.cms_transform(
            colours, profile, imagecodecs.cms_profile("srgb"), colorspace=space, outcolorspace="rgb"
        )
    except imagecodecs.CmsError:
        return samples
    return np.concatenate((converted, samples[..., count:]), axis=2)
