"""Resample photographs: remove the distortion of the lens, crop, and resize."""

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from fecocodec.photographs.framing import crop, framed_intrinsics
from fecocodec.photographs.lens import Lens, distort

_BAND_ROWS = 64  # resampled at a time, so that large photographs need little memory


def undistort(
    image: Float[Tensor, "channel height width"], lens: Lens, pinhole: Lens
) -> Float[Tensor, "channel new_height new_width"]:
    """Resample (bicubic) a photograph taken with `lens` to the image of `pinhole = undistorted(lens)`."""
    if not lens.has_distortion:
        return image
    bands = [
        F.grid_sample(
            image[None],
            _sampling_grid(lens, pinhole, range(top, min(top + _BAND_ROWS, pinhole.height)))[None],
            mode="bicubic",
            padding_mode="border",
            align_corners=False,
        )[0]
        for top in range(0, pinhole.height, _BAND_ROWS)
    ]
    return torch.cat(bands, dim=-2).clamp_(0, 1)


def _sampling_grid(lens: Lens, pinhole: Lens, rows: range) -> Float[Tensor, "row width 2"]:
    """Return the positions, in the photograph, of these rows of the pinhole's image, as `grid_sample` expects them."""
    v, u = np.meshgrid(np.array(rows) + 0.5, np.arange(pinhole.width) + 0.5, indexing="ij")
    plane = np.stack(((u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy), axis=-1)
    source = distort(lens, plane) * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    return torch.from_numpy((2 * source / (lens.width, lens.height) - 1).astype(np.float32))


def crop_and_resize(
    image: Float[Tensor, "channel height width"], pinhole: Lens, size: tuple[int, int]
) -> tuple[Float[Tensor, "channel new_height new_width"], Float[np.ndarray, "3 3"]]:
    """Centre-crop an image to the shape of `size` = (height, width) and resize it (Lanczos, with antialiasing).

    Returns the image and its intrinsics, normalised by width and height.
    """
    height, width = image.shape[-2:]
    intrinsics = framed_intrinsics(pinhole, size)
    top, left, crop_h, crop_w = crop(height, width, size)
    if (crop_h, crop_w) == size:
        return image[:, top : top + size[0], left : left + size[1]], intrinsics
    box = (left, top, min(left + crop_w, width), min(top + crop_h, height))
    planes = [
        np.asarray(Image.fromarray(plane).resize((size[1], size[0]), Image.Resampling.LANCZOS, box=box))
        for plane in image.numpy()
    ]
    return torch.from_numpy(np.stack(planes)).clamp(0, 1), intrinsics
