"""Read photographs of all kinds (`image_headers.IMAGE_SUFFIXES`), and write PNG, JPEG, WebP and OpenEXR.

Colours are converted to sRGB. The EXIF orientation is ignored, because camera files refer to the pixels as they are
stored. Transparent pixels are composited on white by default, the convention of NeRF's synthetic scenes.
"""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from fecocodec.atomic import write_atomically
from fecocodec.errors import OutputError
from fecocodec.input_file import StrPath
from fecocodec.photographs.exr import Photograph, read_exr, write_exr
from fecocodec.photographs.image_headers import is_exr
from fecocodec.photographs.pillow_images import decode_with_pillow

Background = Literal["white", "black"]
LEVELS: dict[Background, float] = {"white": 1.0, "black": 0.0}  # the same in sRGB and in linear light
_SAVE_OPTIONS: dict[str, dict[str, Any]] = {
    ".png": {},
    ".jpg": {"quality": 95, "subsampling": 0},
    ".jpeg": {"quality": 95, "subsampling": 0},
    ".webp": {"quality": 95},
}


def read_image(path: StrPath) -> Float[Tensor, "3 height width"]:
    """Read an image as sRGB in [0, 1], float32. Supports 8 and 16 bits, ICC profiles, grey, palettes and transparency.

    Raises InputError if the file is missing, damaged, too large (64 megapixels, 512 MiB), or of another format.
    """
    return read_photograph(path).colour


def read_photograph(path: StrPath, background: Background = "white") -> Photograph:
    """Read an image like `read_image`, composited on `background`, and its opacity; None if it is opaque everywhere."""
    path = Path(path)
    if is_exr(path):
        found = read_exr(path, LEVELS[background])
    else:
        found = _composited(torch.from_numpy(decode_with_pillow(path, path)), LEVELS[background])
    return replace(found, alpha=None) if found.alpha is not None and bool((found.alpha == 1.0).all()) else found


def decode_image(data: bytes, place: str) -> Float[Tensor, "3 height width"]:
    """Decode the bytes of an image other than OpenEXR like `read_image`; error messages begin with `place`."""
    return _composited(torch.from_numpy(decode_with_pillow(BytesIO(data), place)), LEVELS["white"]).colour


def read_eight_bits(path: StrPath) -> UInt8[np.ndarray, "height width 3"]:
    """Read an image like `read_image`, with 8 bits a channel."""
    return rearrange((read_image(path) * 255).round().to(torch.uint8), "rgb h w -> h w rgb").contiguous().numpy()


def write_image(path: StrPath, image: Float[Tensor, "3 height width"], *, overwrite: bool = False) -> None:
    """Write an sRGB image in [0, 1]. The suffix selects 8 bits (.png, .jpg, .jpeg, .webp) or linear float32 (.exr).

    Raises OutputError if the suffix is not supported, a value is NaN, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        return write_exr(path, image, overwrite=overwrite)
    if suffix not in _SAVE_OPTIONS:
        known = ", ".join((*_SAVE_OPTIONS, ".exr"))
        raise OutputError(f"{path}: images of kind {suffix!r} are not written; use one of {known}.")
    pixels = image.detach().cpu().float()
    if pixels.isnan().any():
        raise OutputError(f"{path}: the image holds NaN; nothing was written, check where it comes from.")
    bytes_hwc = rearrange((pixels.clamp(0, 1) * 255).round().to(torch.uint8), "rgb h w -> h w rgb").numpy()
    with write_atomically(path, overwrite=overwrite) as temporary:
        Image.fromarray(bytes_hwc).save(temporary, **_SAVE_OPTIONS[suffix])


def _composited(pixels: Float[Tensor, "channel height width"], level: float) -> Photograph:
    """Composite 4 channels on a grey level; 3 channels remain as they are."""
    if len(pixels) == 3:
        return Photograph(pixels, None)
    colour, alpha = pixels[:3], pixels[3].clone()
    return Photograph(colour.mul_(alpha).add_(level * (1 - alpha)), alpha)
