"""What a .ply or .spz file of Gaussians says it holds, read before a viewer loads it. No torch."""

import struct
import zlib
from pathlib import Path
from typing import NamedTuple

from fecocodec.errors import InputError

KINDS = (".ply", ".spz")
MAX_BYTES = 384 << 20  # as base64, a longer file would not fit in a string of a browser
_MAX_HEADER_BYTES = 1 << 16
_SPZ_HEADER_BYTES = 12
_SPZ_MAGIC = 0x5053474E
_NEEDED = ({"x", "y", "z", "f_dc_0", "opacity", "scale_0", "rot_0"}, {"packed_position", "packed_scale"})


class SplatHeader(NamedTuple):
    """The kind of a file, an entry of KINDS, and the number of its Gaussians."""

    kind: str
    num_gaussians: int


def read_splat_header(path: Path, data: bytes) -> SplatHeader:
    """Return what a file holds. Raises InputError if these are no Gaussians, or the viewer page cannot read them."""
    kind = path.suffix.lower()
    count = _count_of_spz(path, data) if kind == ".spz" else _count_of_ply(path, data)
    if count == 0:
        raise InputError(f"{path}: the file holds no Gaussians; give one that does.")
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: the page shows files of at most {MAX_BYTES >> 20} MiB; compress it, as .spz.")
    return SplatHeader(kind, count)


def _count_of_ply(path: Path, data: bytes) -> int:
    """Return the number of Gaussians of a binary PLY, in the layout of 3DGS or of PlayCanvas."""
    head, found, _ = data[:_MAX_HEADER_BYTES].partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    counts = [words[2] for words in lines if words[:2] == ["element", "vertex"] and len(words) == 3]
    names = {words[-1] for words in lines if words[:1] == ["property"]}
    is_binary = ["format", "binary_little_endian", "1.0"] in lines
    if lines[:1] != [["ply"]] or not found or not is_binary or len(counts) != 1 or not counts[0].isdecimal():
        raise InputError(f"{path}: this is no binary PLY file; give a .ply file of 3D Gaussians.")
    if not any(needed <= names for needed in _NEEDED):
        raise InputError(
            f"{path}: its points have no scales, rotations and opacities, so they are no Gaussians; give a .ply file "
            "of 3D Gaussians."
        )
    return int(counts[0])


def _count_of_spz(path: Path, data: bytes) -> int:
    """Return the number of Gaussians of an SPZ file of version 1 to 3, which is compressed with gzip as a whole."""
    if data[:4] == struct.pack("<I", _SPZ_MAGIC):
        raise InputError(f"{path}: the page reads SPZ up to version 3; write it again with `spz_version=3`.")
    try:
        header = zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(data, _SPZ_HEADER_BYTES)
        magic, _, count = struct.unpack("<3I", header)
    except (zlib.error, struct.error) as error:
        raise InputError(f"{path}: this is no SPZ file; give an .spz file of 3D Gaussians.") from error
    if magic != _SPZ_MAGIC:
        raise InputError(f"{path}: this is no SPZ file; give an .spz file of 3D Gaussians.")
    return int(count)
