"""OpenEXR files: linear light, and depth along the optical axis in channel Z."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.formats.atomic import write_atomically


@dataclass(frozen=True)
class ExrImage:
    """colour: sRGB in [0, 1]. depth: channel Z in scene units, where the file has one."""

    colour: Float[Tensor, "3 height width"]
    depth: Float[Tensor, "height width"] | None


def read_exr(path: Path) -> ExrImage:
    """Read colour (RGB, RGBA composited on white, or luminance Y) and depth.

    Light above 1 is clipped; NaN counts as 0. Raises InputError where the file cannot be read or has no colour.
    """
    pixels = _read_channels(path)
    if "RGBA" in pixels:  # OpenEXR colour is premultiplied by alpha
        linear = pixels["RGBA"][..., :3] + (1 - pixels["RGBA"][..., 3:])
    elif "RGB" in pixels:
        linear = pixels["RGB"]
    elif "Y" in pixels:
        linear = np.repeat(pixels["Y"][..., None], 3, axis=-1)
    else:
        raise InputError(f"{path}: no colour among the channels {sorted(pixels)}; store R, G and B.")
    colour = linear_to_srgb(torch.from_numpy(np.nan_to_num(linear, nan=0.0)))
    depth = torch.from_numpy(pixels["Z"]) if "Z" in pixels else None
    return ExrImage(rearrange(colour, "h w rgb -> rgb h w").contiguous(), depth)


def read_exr_size(path: Path) -> tuple[int, int]:
    """(height, width) of the stored pixels, from the header alone."""
    try:
        (left, top), (right, bottom) = OpenEXR.File(str(path), header_only=True).header()["dataWindow"]
    except (RuntimeError, ValueError) as error:
        raise InputError(_unreadable(path)) from error
    return int(bottom - top) + 1, int(right - left) + 1


def write_exr(path: Path, image: ExrImage, *, overwrite: bool = False) -> None:
    """Write colour as linear light in float32 channels R, G, B and depth, where there is one, in Z.

    Raises OutputError where the file cannot be written.
    """
    linear = srgb_to_linear(image.colour.detach().cpu().float())
    channels = {"RGB": rearrange(linear, "rgb h w -> h w rgb").contiguous().numpy()}
    if image.depth is not None:
        channels["Z"] = image.depth.detach().cpu().float().contiguous().numpy()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with write_atomically(path, overwrite=overwrite) as temporary:
        try:
            OpenEXR.File(header, channels).write(str(temporary))
        except RuntimeError as error:  # the binding's only error: `... image file "NAME". Reason of the system.`
            reason = str(error).rstrip(".").rpartition('". ')[2]
            raise OSError(reason) from error  # write_atomically makes the sentence


def linear_to_srgb(linear: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The sRGB transfer function (IEC 61966-2-1) of light clipped to [0, 1]."""
    linear = linear.clamp(0, 1)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def srgb_to_linear(srgb: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The inverse of the sRGB transfer function (IEC 61966-2-1)."""
    return torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb.clamp_min(0) + 0.055) / 1.055) ** 2.4)


def _read_channels(path: Path) -> dict[str, Float[np.ndarray, "height width *channel"]]:
    """OpenEXR answers damage with RuntimeError, and with ValueError where no pixels were left to read."""
    try:
        channels = OpenEXR.File(str(path)).channels()
    except (RuntimeError, ValueError) as error:
        raise InputError(_unreadable(path)) from error
    return {name: np.asarray(channel.pixels, np.float32) for name, channel in channels.items()}


def _unreadable(path: Path) -> str:
    return f"{path}: the image is damaged, cut short or not OpenEXR; store it again or leave its view out."
