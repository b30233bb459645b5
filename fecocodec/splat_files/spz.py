"""Write 3D Gaussians as SPZ of Niantic, versions 3 (one gzip stream) and 4 (one zstd frame per attribute).

Layout: `load-spz.cc` of nianticlabs/spz. Positions are 24-bit fixed point numbers. Scales are one byte,
`(log s + 10) * 16`. Rotations are the smallest three components with a sign and 9 bits each. Opacities, colours and
harmonics are one byte, harmonics above degree 0 in [-1, 1]. The axes are RUB (+X right, +Y up, +Z backward).
"""

import gzip
import struct

import numpy as np
import zstandard
from jaxtyping import Float, UInt8

from fecocodec.errors import OutputError
from fecocodec.splat_files.gaussian_arrays import RDF_TO_RUB, OutputGaussians, OutputScene, without_largest
from fecocodec.splat_files.output_formats import SpzVersion

_MAGIC = 0x5053474E
_POSITION_BITS = 24
_MAX_FRACTIONAL_BITS = 23
_HEADER_V4_BYTES = 32
_COLOUR_SCALE = 0.15
_ZSTD_LEVEL = 19


def file_bytes(scene: OutputScene) -> bytes:
    """Return the bytes of the file. Raises OutputError as `spz_bytes` does."""
    return spz_bytes(scene.gaussians, scene.place, scene.spz_version)


def spz_bytes(gaussians: OutputGaussians, place: str, version: SpzVersion = 4) -> bytes:
    """Return the bytes of the file. gaussians: in the frame of the PLY file (RDF axes).

    The number of fractional bits of the positions is the largest that holds the farthest coordinate.
    Raises OutputError, which begins with `place`, if a coordinate exceeds 2^23 units.
    """
    gaussians = gaussians.transformed(RDF_TO_RUB)
    fractional_bits = _fractional_bits(gaussians.means, place)
    streams = _streams(gaussians, fractional_bits)
    fields = (_MAGIC, version, gaussians.count, gaussians.sh_degree, fractional_bits, 0)
    if version == 3:
        header = struct.pack("<3I4B", *fields, 0)
        return gzip.compress(header + b"".join(streams), mtime=0)
    compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL)
    frames = [compressor.compress(stream) for stream in streams]
    header = struct.pack("<3I4BI12x", *fields, len(frames), _HEADER_V4_BYTES)
    sizes = b"".join(struct.pack("<2Q", len(frame), len(stream)) for frame, stream in zip(frames, streams, strict=True))
    return header + sizes + b"".join(frames)


def _streams(gaussians: OutputGaussians, fractional_bits: int) -> list[bytes]:
    """Return the bytes of each attribute in the order of the format."""
    fixed = np.round(gaussians.means * 2.0**fractional_bits).astype("<i4")
    position = fixed.reshape(-1, 1).view(np.uint8)[:, : _POSITION_BITS // 8]
    streams = [
        position,
        _bytes(gaussians.opacities * 255),
        _bytes((gaussians.harmonics[:, 0] * _COLOUR_SCALE + 0.5) * 255),
        _bytes((gaussians.log_scales + 10) * 16),
        _rotations(gaussians.rotations),
        _bytes(gaussians.harmonics[:, 1:] * 128 + 128),
    ]
    return [stream.tobytes() for stream in streams if stream.size]


def _fractional_bits(means: Float[np.ndarray, "n 3"], place: str) -> int:
    farthest = float(np.abs(means).max(initial=0.0))
    limit = 2 ** (_POSITION_BITS - 1) - 1
    bits = _MAX_FRACTIONAL_BITS if farthest == 0 else int(np.floor(np.log2(limit / farthest)))
    if bits < 0:
        raise OutputError(
            f"{place}: a Gaussian lies {farthest:.3g} units from the origin, but .spz holds at most {limit}; write "
            "another format."
        )
    return min(bits, _MAX_FRACTIONAL_BITS)


def _rotations(rotations: Float[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 4"]:
    """Return 2 bits for the index of the largest component of xyzw, then sign and 9 bits for each of the others."""
    largest, others = without_largest(rotations[:, [1, 2, 3, 0]])
    word = largest.astype(np.uint32)
    for component in others.T:
        magnitude = np.floor(np.abs(component) * np.sqrt(2) * 511 + 0.5).clip(0, 511).astype(np.uint32)
        word = (word << np.uint32(10)) | ((component < 0).astype(np.uint32) << np.uint32(9)) | magnitude
    return word.astype("<u4").reshape(-1, 1).view(np.uint8)


def _bytes(values: Float[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape"]:
    return np.round(values).clip(0, 255).astype(np.uint8)
