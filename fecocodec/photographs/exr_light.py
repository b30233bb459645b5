"""Linear sRGB from the channels of OpenEXR files, in any of the ways in which these state colours."""

from typing import Any

import numpy as np
import torch
from einops import einsum
from jaxtyping import Float
from torch import Tensor

from fecocodec.photographs.colour import (
    SRGB_PRIMARIES,
    Chromaticities,
    luminance_weights,
    primaries_to_srgb,
    xyz_to_srgb,
)


def linear_light(
    planes: dict[str, Float[Tensor, "height width"]], chromaticities: Any
) -> Float[Tensor, "3 height width"]:
    """Return linear sRGB from R, G and B, from CIE X, Y and Z (white D65), or from luminance with or without chroma.

    planes: by the kind of channel. chromaticities: as OpenEXR returns them, None if the file states none.
    RY and BY are (R - Y) / Y and (B - Y) / Y, where Y is the luminance of R, G and B in their chromaticities.
    """
    primaries = _primaries(chromaticities)
    if set("RGB") <= planes.keys():
        light = torch.stack([planes[kind] for kind in "RGB"])
    elif set("XYZ") <= planes.keys():
        return _multiplied(xyz_to_srgb(), torch.stack([planes[kind] for kind in "XYZ"]))
    elif {"RY", "BY"} <= planes.keys():
        luma = planes["Y"]
        red, blue = (planes["RY"] + 1) * luma, (planes["BY"] + 1) * luma
        of_red, of_green, of_blue = luminance_weights(primaries).tolist()
        light = torch.stack((red, (luma - of_red * red - of_blue * blue) / of_green, blue))
    else:
        light = planes["Y"].expand(3, -1, -1)
    if primaries == SRGB_PRIMARIES:
        return light
    return _multiplied(primaries_to_srgb(primaries), light)


def _multiplied(matrix: Float[np.ndarray, "3 3"], light: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 h w"]:
    return einsum(torch.from_numpy(matrix), light, "out rgb, rgb h w -> out h w")


def _primaries(chromaticities: Any) -> Chromaticities:
    """Return the file's chromaticities; those of sRGB if it states none, or the same to three digits."""
    if chromaticities is None:
        return SRGB_PRIMARIES
    values = np.asarray(chromaticities, np.float64).ravel().tolist()
    points = tuple((x, y) for x, y in zip(values[0::2], values[1::2], strict=True))
    if len(points) != 4 or np.abs(np.array(points) - SRGB_PRIMARIES).max() < 1e-3:
        return SRGB_PRIMARIES
    return points
