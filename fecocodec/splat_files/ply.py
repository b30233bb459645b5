"""Read 3D Gaussians from binary PLY files of 3DGS; `ply_writing` describes the layout."""

from pathlib import Path

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float

from fecocodec.errors import InputError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.input_file import StrPath, read_file
from fecocodec.splat_files.ply_writing import property_names
from fecocodec.splat_files.ply_writing import write_ply as write_ply

MAX_HEADER_BYTES = 1 << 16
_D_SH_OF_NUM_REST = {3 * (d_sh - 1): d_sh for d_sh in (1, 4, 9, 16, 25)}


def read_ply(path: StrPath) -> Gaussians:
    """Read a 3DGS PLY (binary, little-endian); other properties are ignored.

    Raises InputError if the file is missing, truncated or another kind of PLY, or lacks a property.
    """
    path = Path(path)
    data = read_file(path)
    count, names, start = _parse_header(path, data)
    num_bytes = 4 * count * len(names)
    if len(data) - start < num_bytes:
        raise InputError(
            f"{path}: {count} vertices need {num_bytes} bytes but {len(data) - start} are there; get the whole file."
        )
    table = np.frombuffer(data, "<f4", count * len(names), start).reshape(count, len(names)).astype(np.float64)
    return _gaussians(path, {name: table[:, column] for column, name in enumerate(names)})


def _parse_header(path: Path, data: bytes) -> tuple[int, list[str], int]:
    """Return the number of vertices, the names of their properties and the byte offset of the first vertex."""
    end = data.find(b"end_header\n", 0, MAX_HEADER_BYTES)
    if not data.startswith(b"ply\n") or end < 0:
        raise InputError(f"{path}: this is not a PLY file; give a 3DGS .ply file.")
    lines = data[:end].decode("ascii", "replace").split("\n")
    if "format binary_little_endian 1.0" not in lines:
        raise InputError(f"{path}: only binary little-endian PLY is read; convert the file.")
    starts = [number for number, line in enumerate(lines) if line.startswith("element ")]
    element = lines[starts[0]].split() if starts else []
    if len(element) != 3 or element[1] != "vertex" or not element[2].isdecimal() or len(element[2]) > 12:
        raise InputError(f"{path}: the first element is not `vertex N`; give an uncompressed 3DGS .ply file.")
    first, later, *_ = [*starts, len(lines)]
    properties = [line.split() for line in lines[first:later] if line.startswith("property ")]
    if any(len(words) != 3 or words[1] not in ("float", "float32") for words in properties):
        raise InputError(f"{path}: a vertex property is not a float; give an uncompressed 3DGS .ply file.")
    return int(element[2]), [words[2] for words in properties], end + len(b"end_header\n")


def _gaussians(path: Path, columns: dict[str, Float[np.ndarray, " n"]]) -> Gaussians:
    num_rest = sum(name.startswith("f_rest_") for name in columns)
    needed = property_names(_D_SH_OF_NUM_REST.get(num_rest, 1))
    missing = [name for name in needed if name not in columns and name not in ("nx", "ny", "nz")]
    if missing or num_rest not in _D_SH_OF_NUM_REST:
        raise InputError(f"{path}: not Gaussians (missing {missing}, {num_rest} f_rest); give a 3DGS .ply file.")

    def stack(*names: str) -> Float[np.ndarray, "n column"]:
        return np.stack([columns[name] for name in names], axis=-1)

    rest = stack(*(f"f_rest_{i}" for i in range(num_rest))) if num_rest else np.zeros((len(columns["x"]), 0))
    rest = rearrange(rest, "n (rgb rest) -> n rest rgb", rgb=3)
    harmonics = np.concatenate((stack("f_dc_0", "f_dc_1", "f_dc_2")[:, None], rest), axis=1)
    with np.errstate(over="ignore"):  # overflow gives infinity, which is rejected below
        fields = (
            stack("x", "y", "z"),
            np.exp(stack("scale_0", "scale_1", "scale_2")),
            stack("rot_0", "rot_1", "rot_2", "rot_3"),
            1 / (1 + np.exp(-columns["opacity"])),
            harmonics,
        )
        fields_in_float32 = [field.astype(np.float32) for field in fields]
    if not all(np.isfinite(field).all() for field in fields_in_float32):
        raise InputError(f"{path}: a value is NaN or infinite; write the file again from finite Gaussians.")
    return Gaussians(*(torch.from_numpy(field) for field in fields_in_float32))
