"""Photographs: PNG, JPEG and WebP through Pillow, `.exr` handed to its own file.

The stored pixels count, never the EXIF orientation: camera files are written for the pixels as they are stored.
Transparent pixels are composited on white, as NeRF's synthetic scenes are by convention.
"""

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float
from PIL import Image
from PIL.PngImagePlugin import PngImageFile
from torch import Tensor

from fecocodec.errors import InputError, OutputError
from fecocodec.formats.atomic import write_atomically
from fecocodec.formats.exr import ExrImage, read_exr, read_exr_size, write_exr

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".exr")
_FORMATS = ("PNG", "JPEG", "WEBP")
# Of 16-bit colour Pillow keeps the high bytes; told that the samples have the other byte order, it keeps the low ones.
_LOW_BYTES = {"RGB;16B": "RGB;16L", "RGBA;16B": "RGBA;16L"}
_SAVE_OPTIONS: dict[str, dict[str, Any]] = {
    ".png": {},
    ".jpg": {"quality": 95, "subsampling": 0},
    ".jpeg": {"quality": 95, "subsampling": 0},
    ".webp": {"quality": 95},
}


def read_image(path: Path) -> Float[Tensor, "3 height width"]:
    """Read an image as sRGB in [0, 1], float32; 8 and 16 bits, grey, palette and transparency are handled.

    Raises InputError where the file is missing, damaged, cut, or of another format.
    """
    if path.suffix.lower() == ".exr":
        return read_exr(path).colour
    return _read(path, path)


def decode_image(data: bytes, place: str) -> Float[Tensor, "3 height width"]:
    """`read_image` for the bytes of a PNG, JPEG or WebP file; messages begin with `place`."""
    return _read(BytesIO(data), place)


def read_image_size(path: Path) -> tuple[int, int]:
    """(height, width) of the stored pixels, from the header alone. Raises InputError as `read_image` does."""
    if path.suffix.lower() == ".exr":
        return read_exr_size(path)
    try:
        with _open(path, path) as image:
            return image.height, image.width
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(_unreadable(path, error)) from error


def write_image(path: Path, image: Float[Tensor, "3 height width"], *, overwrite: bool = False) -> None:
    """Write sRGB in [0, 1] by the suffix of `path`: 8 bits for .png, .jpg, .jpeg, .webp; linear float32 for .exr.

    Raises OutputError where the suffix is another one, a value is NaN, or the file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix == ".exr":
        return write_exr(path, ExrImage(image, None), overwrite=overwrite)
    if suffix not in _SAVE_OPTIONS:
        raise OutputError(f"{path}: images of kind {suffix!r} are not written; use one of {', '.join(IMAGE_SUFFIXES)}.")
    pixels = image.detach().cpu().float()
    if pixels.isnan().any():
        raise OutputError(f"{path}: the image holds NaN; nothing was written, check where it comes from.")
    bytes_hwc = rearrange((pixels.clamp(0, 1) * 255).round().to(torch.uint8), "rgb h w -> h w rgb").numpy()
    with write_atomically(path, overwrite=overwrite) as temporary:
        Image.fromarray(bytes_hwc).save(temporary, **_SAVE_OPTIONS[suffix])


def _read(source: Path | BytesIO, place: Path | str) -> Float[Tensor, "3 height width"]:
    try:
        with _open(source, place) as image:
            low_bytes = _low_bytes_of(image)
            pixels = _rgb(image) if low_bytes is None else np.asarray(image, np.float32)
        if low_bytes is not None:
            with _open(source, place) as image:
                pixels = _on_white((256 * pixels + _samples_as(low_bytes, image)) / 65535)
    except (OSError, ValueError, SyntaxError) as error:  # Pillow reports damage in all three ways
        raise InputError(_unreadable(place, error)) from error
    return rearrange(torch.from_numpy(pixels), "h w rgb -> rgb h w").contiguous()


def _open(source: Path | BytesIO, place: Path | str) -> Image.Image:
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            return Image.open(source, formats=_FORMATS)
        except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
            raise InputError(f"{place}: the image has too many pixels ({error}); store it smaller.") from error


def _rgb(image: Image.Image) -> Float[np.ndarray, "height width 3"]:
    if image.mode.startswith("I"):  # 16-bit grey
        grey = np.asarray(image, np.float32) / 65535
        return np.repeat(grey[..., None], 3, axis=-1)
    if image.has_transparency_data:
        return _on_white(np.asarray(image.convert("RGBA"), np.float32) / 255)
    return np.asarray(image.convert("RGB"), np.float32) / 255


def _low_bytes_of(image: Image.Image) -> str | None:
    """The raw mode that reads the low bytes of a PNG with 16 bits a colour; None for all other images."""
    if not isinstance(image, PngImageFile) or not image.tile or "transparency" in image.info:
        return None
    return _LOW_BYTES.get(str(image.tile[0][3]))


def _samples_as(raw_mode: str, image: Any) -> Float[np.ndarray, "height width channel"]:
    """The samples of a PNG that was only opened, when its bytes are taken for those of another raw mode."""
    image.tile = [(*image.tile[0][:3], raw_mode)]
    return np.asarray(image, np.float32)


def _on_white(pixels: Float[np.ndarray, "height width channel"]) -> Float[np.ndarray, "height width 3"]:
    """Colours without, or with a fourth channel of opacity."""
    alpha = pixels[..., 3:]
    return pixels[..., :3] * alpha + (1 - alpha) if alpha.size else pixels


def _unreadable(place: Path | str, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"{place}: no such image; put it there or leave its view out."
    if isinstance(error, OSError) and error.strerror:  # from the system; Pillow's own have none
        return f"{place}: cannot be read ({error.strerror}); check the path and its permissions."
    return f"{place}: the image is damaged, cut short or not PNG, JPEG or WebP ({error}); store it again."
