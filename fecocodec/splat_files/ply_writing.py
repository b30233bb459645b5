"""Write 3D Gaussians as binary PLY files of 3DGS. No torch.

Layout: Kerbl et al. 2023, reference implementation, `GaussianModel.save_ply`. Scales are stored as logarithms,
opacities as logits, and the harmonics above degree 0 channel by channel (all of red, then green, then blue).
"""

from pathlib import Path
from typing import Any

import numpy as np
from einops import rearrange
from jaxtyping import Float32

from fecocodec.atomic import write_file
from fecocodec.input_file import StrPath
from fecocodec.splat_files.gaussian_arrays import OutputScene, gaussian_arrays


def write_ply(path: StrPath, gaussians: Any, *, overwrite: bool = False) -> None:
    """Write one scene's Gaussians (no batch axis), tensors or arrays, as a 3DGS PLY, float32, little-endian.

    Raises OutputError if a value is not finite or out of range (scales must be above 0), or the file cannot be written.
    """
    path = Path(path)
    data = ply_bytes(gaussians, str(path))
    write_file(path, data, overwrite=overwrite)


def file_bytes(scene: OutputScene) -> bytes:
    """Return the bytes of the file."""
    return ply_bytes(scene.gaussians, scene.place)


def ply_bytes(gaussians: Any, place: str) -> bytes:
    """Return the bytes that `write_ply` writes. Raises OutputError, beginning with `place`, for values out of range."""
    columns = _columns(place, gaussians)
    names = property_names(gaussians.harmonics.shape[-2])
    header = "".join(
        (
            "ply\nformat binary_little_endian 1.0\n",
            f"element vertex {gaussians.count}\n",
            *(f"property float {name}\n" for name in names),
            "end_header\n",
        )
    )
    return b"".join((header.encode("ascii"), columns.data))


def property_names(d_sh: int) -> list[str]:
    """Return the names of the properties of a vertex."""
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * (d_sh - 1))]
    return [*names, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def _columns(place: str, gaussians: Any) -> Float32[np.ndarray, "n property"]:
    arrays = gaussian_arrays(gaussians, place)
    columns = (
        arrays.means,
        np.zeros_like(arrays.means),  # normals, which viewers expect but do not use
        arrays.harmonics[:, 0],
        rearrange(arrays.harmonics[:, 1:], "n rest rgb -> n (rgb rest)"),
        arrays.logits[:, None],
        arrays.log_scales,
        arrays.rotations,
    )
    return np.concatenate(columns, axis=1, dtype="<f4", casting="same_kind")
