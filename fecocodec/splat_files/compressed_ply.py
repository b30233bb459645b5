"""Write 3D Gaussians as compressed PLY of PlayCanvas and SuperSplat: 16 bytes a Gaussian, and 9 for harmonics.

Layout: `element chunk` with the bounds of 256 Gaussians each, `element vertex` with position and scale in 11, 10 and 11
bits, rotation in 2 + 3 x 10 bits and colour and opacity in 8 bits each, `element sh` with one byte per coefficient.
The frame is that of the uncompressed PLY.
"""

import numpy as np
from jaxtyping import Float, UInt32

from fecocodec.geometry.gaussian_arrays import SH_DEGREE_0
from fecocodec.geometry.kd_leaves import kd_leaves
from fecocodec.splat_files.gaussian_arrays import OutputScene, without_largest

CHUNK = 256
HARMONICS_RANGE = 4.0  # harmonics above degree 0 are clipped to +-4
_MAX_LOG_SCALE = 20.0
_BOUNDS = [
    f"{end}_{axis}"
    for axes in (("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b"))
    for end in ("min", "max")
    for axis in axes
]
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")


def file_bytes(scene: OutputScene) -> bytes:
    """Return the bytes of the file. The Gaussians are reordered such that the bounds of a chunk are tight."""
    gaussians = scene.gaussians.ordered(np.concatenate(kd_leaves(scene.gaussians.means, CHUNK)))
    colour = 0.5 + SH_DEGREE_0 * gaussians.harmonics[:, 0]
    log_scales = gaussians.log_scales.clip(-_MAX_LOG_SCALE, _MAX_LOG_SCALE)
    bounds, (position, scale, rgb) = _normalised([gaussians.means, log_scales, colour])
    vertices = np.stack(
        (
            _packed(position, (11, 10, 11)),
            _packed_rotations(gaussians.rotations),
            _packed(scale, (11, 10, 11)),
            _packed(np.concatenate((rgb, gaussians.opacities[:, None]), axis=1), (8, 8, 8, 8)),
        ),
        axis=1,
    )
    rest = gaussians.harmonics[:, 1:].transpose(0, 2, 1).reshape(gaussians.count, -1)  # all of red, green, blue
    bytes_of_rest = np.floor((rest / (2 * HARMONICS_RANGE) + 0.5) * 256).clip(0, 255).astype(np.uint8)
    header = _header(len(bounds), gaussians.count, rest.shape[1])
    return header + bounds.astype("<f4").tobytes() + vertices.astype("<u4").tobytes() + bytes_of_rest.tobytes()


def _header(num_chunks: int, count: int, num_rest: int) -> bytes:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element chunk {num_chunks}",
        *(f"property float {name}" for name in _BOUNDS),
        f"element vertex {count}",
        *(f"property uint {name}" for name in _PACKED),
        *([f"element sh {count}"] if num_rest else []),
        *(f"property uchar f_rest_{index}" for index in range(num_rest)),
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii")


def _normalised(
    columns: list[Float[np.ndarray, "n 3"]],
) -> tuple[Float[np.ndarray, "chunk 18"], list[Float[np.ndarray, "n 3"]]]:
    """Return minima and maxima of each column in every chunk, and the values as shares of the range between them."""
    starts = np.arange(0, len(columns[0]), CHUNK)
    sizes = np.diff(np.append(starts, len(columns[0])))
    bounds, shares = [], []
    for values in columns:
        # In float32, as a reader will see the bounds.
        low, high = (reduce.reduceat(values, starts).astype(np.float32) for reduce in (np.minimum, np.maximum))
        bounds += [low, high]
        start, end = (np.repeat(bound.astype(np.float64), sizes, axis=0) for bound in (low, high))
        shares.append(((values - start) / np.where(end > start, end - start, 1.0)).clip(0.0, 1.0))
    return np.concatenate(bounds, axis=1), shares


def _packed(shares: Float[np.ndarray, "n component"], bits: tuple[int, ...]) -> UInt32[np.ndarray, " n"]:
    """Quantise values in [0, 1] to these numbers of bits and join them, the first in the highest bits."""
    word = np.zeros(len(shares), np.uint32)
    for share, width in zip(shares.T, bits, strict=True):
        word = (word << np.uint32(width)) | np.round(share * (2**width - 1)).astype(np.uint32)
    return word


def _packed_rotations(rotations: Float[np.ndarray, "n 4"]) -> UInt32[np.ndarray, " n"]:
    largest, others = without_largest(rotations)
    return (largest.astype(np.uint32) << np.uint32(30)) | _packed((others / np.sqrt(2) + 0.5).clip(0, 1), (10, 10, 10))
