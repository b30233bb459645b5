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
from fecocodec.photographs.exr_light import linear_light
from fecocodec.photographs.pillow_images import require_few_pixels, unreadable
from fecocodec.photographs.silence import silenced

_MAX_VALUES = 4 * MAX_IMAGE_PIXELS  # over all channels and parts; OpenEXR reads them all
_HALF_STEP = 5e-4  # half of the distance of 1 to the next half float
_LONG_KINDS = {"red": "R", "green": "G", "blue": "B", "alpha": "A"}
_USUAL_NAMES = {"combined", "beauty", "rgba", "rgb", "color", "colour"}  # of the layer that shows the picture


@dataclass(frozen=True)
class Photograph:
    """Pixels of a photograph.

    colour: sRGB in [0, 1]. alpha: opacity in [0, 1], None without transparency. Of OpenEXR alone: clipped, the share of
    pixels with light above 1, which is clipped; blackened, of those with a value that is NaN or negative, which becomes
    0.
    """

    colour: Float[Tensor, "3 height width"]
    alpha: Float[Tensor, "height width"] | None
    clipped: float = 0.0
    blackened: float = 0.0


def read_exr(path: Path, background: float = 1.0) -> Photograph:
    """Read colour and opacity in the display window; what the data window leaves out is black and transparent.

    Colour is R, G and B, CIE X, Y and Z, luminance Y, or Y with the chroma channels RY and BY, of the part and layer
    that `colour_layer` chooses. It is composited on a background if there is opacity A. Stated chromaticities are
    converted to sRGB. background: linear grey level; 1 is white.
    Values above 1 are clipped; NaN counts as 0. Raises InputError if the file cannot be read, has no colour, or has
    more than MAX_IMAGE_PIXELS pixels.
    """
    read_exr_size(path)  # refuses too many pixels before they are allocated
    try:
        with silenced():
            parts = OpenEXR.File(str(path), separate_channels=True).parts
        part, layer = _chosen(path, parts)
        planes = {name: _in_display_window(part, layer.channels[name]) for name in layer.channels}
    except (RuntimeError, ValueError, KeyError) as error:  # OpenEXR reports damage by any of them
        raise InputError(_unreadable(path)) from error
    alpha = planes.get("A")
    light = linear_light(planes, part.header.get("chromaticities"))
    if alpha is not None:  # OpenEXR colour is premultiplied by alpha
        light = light + background * (1 - alpha)
    light = light.nan_to_num(nan=0.0)
    stored = torch.stack([plane for name, plane in planes.items() if name in ("R", "G", "B", "Y")])
    blackened = (stored.isnan() | (stored < -_HALF_STEP)).any(dim=0).float().mean().item()
    clipped = (light > 1 + _HALF_STEP).any(dim=0).float().mean().item()
    opacity = None if alpha is None else alpha.nan_to_num(nan=0.0).clamp(0, 1)
    return Photograph(linear_to_srgb(light), opacity, clipped, blackened)


def read_exr_size(path: Path) -> tuple[int, int]:
    """Return (height, width) of the display window, from the header alone.

    Raises InputError if there are more than MAX_IMAGE_PIXELS pixels, or too many channels and parts to decode.
    """
    parts = _headers(path)
    try:
        sizes = [(*_size(part.header["dataWindow"]), len(part.header["channels"])) for part in parts]
        displayed = [_size(part.header["displayWindow"]) for part in parts]
        for height, width in (*displayed, *((height, width) for height, width, _ in sizes)):
            require_few_pixels(height, width, path)
        if sum(height * width * channels for height, width, channels in sizes) > _MAX_VALUES:
            raise InputError(f"{path}: the image has too many channels or parts for its size; store R, G and B alone.")
        height, width = _size(_chosen(path, parts)[0].header["displayWindow"])
    except (RuntimeError, ValueError, KeyError) as error:
        raise InputError(_unreadable(path)) from error
    return height, width


def colour_layer(path: Path) -> str:
    """Return the part or layer that holds the colours; empty for the first part's own channels R, G and B, or Y.

    Without these, it is the only layer with colour, or among several that with a usual name (`Combined`, `beauty`,
    `rgba`). Raises InputError if there is no colour, or no such layer among several.
    """
    parts = _headers(path)
    part, layer = _chosen(path, parts)
    return layer.name if part is parts[0] else " ".join(filter(None, (_part_name(part), layer.name)))


@dataclass(frozen=True)
class _Layer:
    """Channels with one prefix. channels: names in the file by their kind, such as R."""

    name: str
    channels: dict[str, str]

    @property
    def has_colour(self) -> bool:
        if set("XYZ") <= self.channels.keys() and self.name:  # normals or positions
            return False
        return {"R", "G", "B"} <= self.channels.keys() or "Y" in self.channels


def _layers(part: Any) -> list[_Layer]:
    """Return the layers of a part: `ViewLayer.Combined.R` is channel R of layer `ViewLayer.Combined`."""
    layers: dict[str, dict[str, str]] = {}
    for channel in part.header["channels"]:
        layer, _, kind = channel.name.rpartition(".")
        layers.setdefault(layer, {})[_LONG_KINDS.get(kind.lower(), kind.upper())] = channel.name
    return [_Layer(name, channels) for name, channels in layers.items()]


def _chosen(path: Path, parts: list[Any]) -> tuple[Any, _Layer]:
    """Return part and layer of the colours, see `colour_layer`."""
    coloured = [(part, layer) for part in parts for layer in _layers(part) if layer.has_colour]
    if not coloured:
        names = sorted(channel.name for part in parts for channel in part.header["channels"])
        if not names:  # of a file that is cut short, OpenEXR reads none
            raise InputError(_unreadable(path))
        raise InputError(f"{path}: no colour among the channels {names}; store R, G and B.")
    plain = [(part, layer) for part, layer in coloured if not layer.name]
    named = [
        (part, layer)
        for part, layer in coloured
        if {layer.name.split(".")[-1].lower(), _part_name(part)} & _USUAL_NAMES
    ]
    if found := plain or named or (coloured if len(coloured) == 1 else []):
        return found[0]
    layers = ", ".join(layer.name for _, layer in coloured)
    raise InputError(f"{path}: several layers have colour ({layers}); store the wanted one as R, G and B.")


def _part_name(part: Any) -> str:
    return str(part.header.get("name", "")).lower()


def _headers(path: Path) -> list[Any]:
    """Return the parts, without pixels."""
    try:
        require_regular_file(path)
        with silenced():
            parts: list[Any] = OpenEXR.File(str(path), header_only=True).parts
        return parts
    except OSError as error:
        raise InputError(unreadable(path, error)) from error
    except (RuntimeError, ValueError, KeyError) as error:
        raise InputError(_unreadable(path)) from error


def _size(window: Any) -> tuple[int, int]:
    """Return (height, width)."""
    (left, top), (right, bottom) = window
    return int(bottom) - int(top) + 1, int(right) - int(left) + 1


def _in_display_window(part: Any, name: str) -> Float[Tensor, "height width"]:
    """Return a channel at the pixels of the display window, 0 where the file has none."""
    channel = part.channels[name]
    values = torch.from_numpy(np.array(channel.pixels, np.float32))
    for axis, sampling in enumerate((channel.ySampling, channel.xSampling)):
        if sampling > 1:
            values = _upsampled(values, axis, sampling)
    (left, top), _ = part.header["dataWindow"]
    (display_left, display_top), _ = part.header["displayWindow"]
    down, right = int(top) - int(display_top), int(left) - int(display_left)
    height, width = _size(part.header["displayWindow"])
    plane = torch.zeros(height, width)
    inside = values[max(0, -down) : max(0, height - down), max(0, -right) : max(0, width - right)]
    rows, columns = inside.shape
    plane[max(0, down) : max(0, down) + rows, max(0, right) : max(0, right) + columns] = inside
    return plane


def _upsampled(values: Float[Tensor, "height width"], axis: int, factor: int) -> Float[Tensor, "new_height new_width"]:
    """Interpolate linearly between samples, which lie at every `factor`-th pixel from the first one."""
    position = torch.arange(values.shape[axis] * factor) / factor
    before = position.long()
    after = (before + 1).clamp_max(values.shape[axis] - 1)
    weight = (position - before)[:, None] if axis == 0 else position - before
    return values.index_select(axis, before) * (1 - weight) + values.index_select(axis, after) * weight


def write_exr(
    path: Path,
    colour: Float[Tensor, "3 height width"],
    depth: Float[Tensor, "height width"] | None = None,
    *,
    overwrite: bool = False,
) -> None:
    """Write colour as linear float32 channels R, G, B, and depth, if any, as Z. Raises OutputError if writing fails."""
    linear = srgb_to_linear(colour.detach().cpu().float())
    channels = {"RGB": rearrange(linear, "rgb h w -> h w rgb").contiguous().numpy()}
    if depth is not None:
        channels["Z"] = depth.detach().cpu().float().contiguous().numpy()
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


def _unreadable(path: Path) -> str:
    return f"{path}: the image is damaged, cut short or not OpenEXR; store it again or leave its view out."
