"""OpenEXR files: linear light, and depth along the optical axis in channel Z."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.atomic import write_atomically
from fecocodec.errors import InputError
from fecocodec.input_file import MAX_IMAGE_PIXELS, require_regular_file
from fecocodec.photographs.pillow_images import require_few_pixels, unreadable

_MAX_VALUES = 4 * MAX_IMAGE_PIXELS  # over all channels and parts; OpenEXR reads them all


@dataclass(frozen=True)
class ExrImage:
    """Content of an OpenEXR file; None for what the file lacks.

    colour: sRGB in [0, 1]. depth: channel Z, in scene units. alpha: opacity in [0, 1].
    """

    colour: Float[Tensor, "3 height width"]
    depth: Float[Tensor, "height width"] | None
    alpha: Float[Tensor, "height width"] | None = None


def read_exr(path: Path, background: float = 1.0) -> ExrImage:
    """Read colour (RGB, RGBA composited on a background, or luminance Y), depth and opacity.

    background: linear grey level of the background; 1 is white.
    Values above 1 are clipped; NaN counts as 0. Raises InputError if the file cannot be read, has no colour, or has
    more than MAX_IMAGE_PIXELS pixels.
    """
    read_exr_size(path)  # refuses too many pixels before they are allocated
    channels = _read_channels(path)
    alpha = None
    if "RGBA" in channels:  # OpenEXR colour is premultiplied by alpha
        alpha = _plane(channels["RGBA"][..., 3])
        linear = [_plane(channels["RGBA"][..., channel]) + background * (1 - alpha) for channel in range(3)]
    elif "RGB" in channels:
        linear = [_plane(channels["RGB"][..., channel]) for channel in range(3)]
    elif "Y" in channels:
        linear = 3 * [_plane(channels["Y"])]
    else:
        raise InputError(f"{path}: no colour among the channels {sorted(channels)}; store R, G and B.")
    colour = torch.empty(3, *linear[0].shape)
    for channel, plane in enumerate(linear):  # one at a time, to need little memory
        colour[channel] = linear_to_srgb(plane.nan_to_num(nan=0.0))
    depth = _plane(channels["Z"]) if "Z" in channels else None
    return ExrImage(colour, depth, None if alpha is None else alpha.nan_to_num(nan=0.0).clamp(0, 1))


def read_exr_size(path: Path) -> tuple[int, int]:
    """Return (height, width) of the stored pixels, from the header alone.

    Raises InputError if there are more than MAX_IMAGE_PIXELS pixels, or too many channels and parts to decode.
    """
    try:
        require_regular_file(path)
        parts = OpenEXR.File(str(path), header_only=True).parts
        sizes = [_part_size(part.header) for part in parts]
    except OSError as error:
        raise InputError(unreadable(path, error)) from error
    except (RuntimeError, ValueError, KeyError) as error:
        raise InputError(_unreadable(path)) from error
    height, width, _ = sizes[0]
    require_few_pixels(height, width, path)
    if sum(h * w * channels for h, w, channels in sizes) > _MAX_VALUES:
        raise InputError(f"{path}: the image has too many channels or parts for its size; store R, G and B alone.")
    return height, width


def _part_size(header: dict[str, Any]) -> tuple[int, int, int]:
    """Return (height, width, number of channels) of one part."""
    (left, top), (right, bottom) = header["dataWindow"]
    return int(bottom) - int(top) + 1, int(right) - int(left) + 1, len(header["channels"])


def write_exr(path: Path, image: ExrImage, *, overwrite: bool = False) -> None:
    """Write colour as linear float32 channels R, G, B, and depth, if present, as channel Z.

    Raises OutputError if the file cannot be written.
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
            raise OSError(reason) from error  # write_atomically adds path and remedy to the message


def linear_to_srgb(linear: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Apply the sRGB transfer function (IEC 61966-2-1) to linear values, clipped to [0, 1]."""
    linear = linear.clamp(0, 1)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def srgb_to_linear(srgb: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Apply the inverse of the sRGB transfer function (IEC 61966-2-1)."""
    return torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb.clamp_min(0) + 0.055) / 1.055) ** 2.4)


def _read_channels(path: Path) -> dict[str, np.ndarray]:
    """Read all channels. OpenEXR reports damage as RuntimeError, or as ValueError if no pixels are left to read."""
    try:
        channels = OpenEXR.File(str(path)).channels()
        return {name: channel.pixels for name, channel in channels.items()}
    except (RuntimeError, ValueError) as error:
        raise InputError(_unreadable(path)) from error


def _plane(values: np.ndarray) -> Float[Tensor, "height width"]:
    return torch.from_numpy(np.array(values, np.float32))


def _unreadable(path: Path) -> str:
    return f"{path}: the image is damaged, cut short or not OpenEXR; store it again or leave its view out."
