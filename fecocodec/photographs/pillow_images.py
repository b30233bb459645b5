"""Decode PNG, JPEG and WebP with Pillow. Bounds the number of pixels and raises only InputError."""

import struct
import warnings
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8, UInt16
from PIL import ExifTags, Image, UnidentifiedImageError

from fecocodec.errors import InputError
from fecocodec.input_file import MAX_IMAGE_PIXELS, require_regular_file
from fecocodec.photographs.png16 import HEAD_BYTES, decode_sixteen_bits, has_sixteen_bits

_FORMATS = ("PNG", "JPEG", "WEBP")
UPRIGHT, LAST_ORIENTATION = 1, 8  # of EXIF


def decode_with_pillow(source: Path | BytesIO, place: Path | str) -> Float[np.ndarray, "channel height width"]:
    """Return 3 channels of sRGB in [0, 1], or 4 if the image has opacity (not premultiplied).

    Pillow reads the header of every image; PNG images with 16 bits per channel are then decoded by `png16`.
    Raises InputError, which begins with `place`, if the image is missing, damaged, too large or of another format.
    """
    try:
        with _open(source, place) as image:
            data = _bytes_of_sixteen_bits(source)
            return _in_unit_range(_samples(image) if data is None else decode_sixteen_bits(data, str(place)))
    except (InputError, MemoryError):
        raise
    except Exception as error:  # Pillow reports damage in many ways: OSError, SyntaxError, AssertionError, struct.error
        raise InputError(unreadable(place, error)) from error


def size_with_pillow(path: Path) -> tuple[int, int]:
    """Return (height, width) from the header alone. Raises InputError as `decode_with_pillow` does."""
    try:
        with _open(path, path) as image:
            return image.height, image.width
    except (InputError, MemoryError):
        raise
    except Exception as error:  # as above
        raise InputError(unreadable(path, error)) from error


def orientation_with_pillow(path: Path) -> int:
    """Return the EXIF orientation, from 1 (upright) to 8; 1 for an image without readable EXIF data.

    Raises InputError as `decode_with_pillow` does for an image that cannot be opened.
    """
    with _open(path, path) as image, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about damaged EXIF data
        try:
            found = image.getexif().get(ExifTags.Base.Orientation, UPRIGHT)
        except (OSError, SyntaxError, ValueError, struct.error):  # what Pillow raises for damaged EXIF data
            return UPRIGHT
    return found if isinstance(found, int) and UPRIGHT <= found <= LAST_ORIENTATION else UPRIGHT


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
    has_reason = str(error) and not isinstance(error, UnidentifiedImageError)  # which only repeats the path
    reason = f" ({error})" if has_reason else ""
    return f"{place}: the image is damaged, cut short or not PNG, JPEG or WebP{reason}; store it again or remove it."


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


def _bytes_of_sixteen_bits(source: Path | BytesIO) -> bytes | None:
    """Return the bytes of a PNG with 16 bits per channel; None for all other images."""
    if isinstance(source, BytesIO):
        data = source.getvalue()
        return data if has_sixteen_bits(data[:HEAD_BYTES]) else None
    with source.open("rb") as file:
        head = file.read(HEAD_BYTES)
        return head + file.read() if has_sixteen_bits(head) else None


def _samples(image: Image.Image) -> UInt8[np.ndarray, "height width channel"]:
    """Return 8-bit samples with 3 or 4 channels."""
    return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))


def _in_unit_range(
    samples: UInt8[np.ndarray, "height width samples"] | UInt16[np.ndarray, "height width samples"],
) -> Float[np.ndarray, "channel height width"]:
    """Return 3 or 4 channels in [0, 1]; grey, with or without opacity, becomes three equal channels."""
    count = samples.shape[2]
    order = {1: (0, 0, 0), 2: (0, 0, 0, 1)}.get(count, tuple(range(count)))
    largest = np.float32(np.iinfo(samples.dtype).max)
    pixels = np.empty((len(order), *samples.shape[:2]), np.float32)
    for channel, plane in zip(order, pixels, strict=True):  # one at a time, to need little memory
        np.divide(samples[..., channel], largest, out=plane, dtype=np.float32)
    return pixels
