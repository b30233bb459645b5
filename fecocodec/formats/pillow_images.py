"""Decode PNG, JPEG and WebP with Pillow. Bounds the number of pixels and raises only InputError."""

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from fecocodec.errors import InputError
from fecocodec.formats.input_file import MAX_IMAGE_PIXELS, require_regular_file

_FORMATS = ("PNG", "JPEG", "WEBP")
# Pillow keeps the high bytes of 16-bit colour. If the samples are declared to have the other byte order, it keeps the
# low bytes.
_LOW_BYTES = {"RGB;16B": "RGB;16L", "RGBA;16B": "RGBA;16L"}


def decode_with_pillow(source: Path | BytesIO, place: Path | str) -> Float[np.ndarray, "channel height width"]:
    """Return 3 channels of sRGB in [0, 1], or 4 if the image has opacity (not premultiplied).

    Raises InputError, which begins with `place`, if the image is missing, damaged, too large or of another format.
    """
    try:
        with _open(source, place) as image:
            low_bytes = _low_bytes_of(image)
            samples = _samples(image) if low_bytes is None else np.asarray(image)
        if low_bytes is not None:
            with _open(source, place) as image:
                return _sixteen_bits(samples, _samples_as(low_bytes, image))
    except (InputError, MemoryError):
        raise
    except Exception as error:  # Pillow reports damage in many ways: OSError, SyntaxError, AssertionError, struct.error
        raise InputError(unreadable(place, error)) from error
    return _in_unit_range(samples)


def size_with_pillow(path: Path) -> tuple[int, int]:
    """Return (height, width) from the header alone. Raises InputError as `decode_with_pillow` does."""
    try:
        with _open(path, path) as image:
            return image.height, image.width
    except (InputError, MemoryError):
        raise
    except Exception as error:  # as above
        raise InputError(unreadable(path, error)) from error


def require_few_pixels(height: int, width: int, place: Path | str) -> None:
    """Raise InputError if an image has more than MAX_IMAGE_PIXELS pixels."""
    if height * width > MAX_IMAGE_PIXELS:
        raise InputError(
            f"{place}: the image has too many pixels ({width}x{height}, at most {MAX_IMAGE_PIXELS} in all); "
            "store it smaller."
        )


def unreadable(place: Path | str, error: Exception) -> str:
    """Return the error message for an image that cannot be read."""
    if isinstance(error, FileNotFoundError):
        return f"{place}: no such image; put it there or leave its view out."
    if isinstance(error, OSError) and error.strerror:  # from the system; Pillow's own errors have none
        return f"{place}: cannot be read ({error.strerror}); check the path and its permissions."
    reason = str(error) or type(error).__name__
    return f"{place}: the image is damaged, cut short or not PNG, JPEG or WebP ({reason}); store it again."


def _open(source: Path | BytesIO, place: Path | str) -> Image.Image:
    if isinstance(source, Path):
        require_regular_file(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damage that Pillow repairs, and about sizes, which are checked below
        try:
            image = Image.open(source, formats=_FORMATS)
        except Image.DecompressionBombError as error:
            raise InputError(f"{place}: the image has too many pixels; store it smaller.") from error
    require_few_pixels(image.height, image.width, place)
    return image


def _samples(image: Image.Image) -> np.ndarray:
    """Return 8-bit samples with 3 or 4 channels, or 16-bit samples with one channel."""
    if image.mode.startswith("I"):  # 16-bit grey
        return np.asarray(image)
    return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))


def _in_unit_range(samples: np.ndarray) -> Float[np.ndarray, "channel height width"]:
    if samples.ndim == 2:
        grey = np.asarray(samples, np.float32) / 65535
        return np.repeat(grey[None], 3, axis=0)
    pixels = np.empty((samples.shape[2], *samples.shape[:2]), np.float32)
    for channel, plane in enumerate(pixels):  # one at a time, to need little memory
        np.divide(samples[..., channel], np.float32(255), out=plane, dtype=np.float32)
    return pixels


def _low_bytes_of(image: Image.Image) -> str | None:
    """Return the raw mode that reads the low bytes of a PNG with 16 bits per colour; None for all other images."""
    if not isinstance(image, PngImageFile) or not image.tile or "transparency" in image.info:
        return None
    return _LOW_BYTES.get(str(image.tile[0][3]))


def _samples_as(raw_mode: str, image: Any) -> UInt8[np.ndarray, "height width channel"]:
    """Return the samples of a PNG that was opened but not read, with its bytes interpreted in another raw mode."""
    image.tile = [(*image.tile[0][:3], raw_mode)]
    return np.asarray(image)


def _sixteen_bits(
    high: UInt8[np.ndarray, "height width channel"], low: UInt8[np.ndarray, "height width channel"]
) -> Float[np.ndarray, "channel height width"]:
    pixels = np.empty((high.shape[2], *high.shape[:2]), np.float32)
    for channel, plane in enumerate(pixels):
        np.multiply(high[..., channel], np.float32(256), out=plane, dtype=np.float32)
        plane += low[..., channel]
        plane /= 65535
    return pixels
