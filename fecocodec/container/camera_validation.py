"""Validation of the cameras of a stream, when writing and when reading (FORMAT.md, section 6.3).

Within these bounds, the float32 arithmetic of decoding stays finite.
"""

import math
import struct
from collections.abc import Iterator

from fecocodec.container.cameras import PackedCameras
from fecocodec.errors import BitstreamError

ORTHONORMAL_TOLERANCE = 1e-3  # on every element of R R^T - I
MIN_NEAR, MAX_NEAR = 2.0**-40, 2.0**40
MIN_DEPTH_RATIO, MAX_DEPTH_RATIO = 1.0 + 2.0**-9, 2.0**14  # far / near
MAX_COORDINATE = 2.0**60  # of a camera centre
MAX_DISTANCE = 2.0**14  # of a camera centre from the mean centre, per coordinate, in units of near
MIN_FOCAL, MAX_FOCAL = 2.0**-6, 2.0**8  # in image widths or heights
MAX_PRINCIPAL_POINT = 2.0**8

_COMPONENTS = ("r00", "r01", "r02", "tx", "r10", "r11", "r12", "ty", "r20", "r21", "r22", "tz", "fx", "fy", "cx", "cy")


def check_cameras(cameras: PackedCameras, place: str) -> None:
    """Raise BitstreamError for the first rule that the cameras break.

    place: start of the message, such as "section cameras"; the message also names the camera, counted from 1.
    """
    for problem in _problems(cameras):
        raise BitstreamError(f"{place}: {problem}")


def _problems(cameras: PackedCameras) -> Iterator[str]:
    yield from _depth_problems(cameras.near, cameras.far)
    if len(cameras.extrinsics) != len(cameras.intrinsics):
        yield f"{len(cameras.extrinsics)} extrinsics and {len(cameras.intrinsics)} intrinsics; give as many of each."
    for number, (extrinsics, intrinsics) in enumerate(zip(cameras.extrinsics, cameras.intrinsics, strict=False), 1):
        for problem in _view_problems(extrinsics, intrinsics):
            yield f"camera {number} of {cameras.num_views}: {problem}"
    yield from _distance_problems(cameras)


def _distance_problems(cameras: PackedCameras) -> Iterator[str]:
    """Compare the camera centres with their mean, in binary64 as FORMAT.md, section 6.4, requires."""
    centres = [pose[3::4] for pose in cameras.extrinsics]
    origin = [sum(coordinates) / len(centres) for coordinates in zip(*centres, strict=True)]
    for number, centre in enumerate(centres, 1):
        farthest = max(abs(value - mean) for value, mean in zip(centre, origin, strict=True))
        if farthest > MAX_DISTANCE * cameras.near:
            yield (
                f"camera {number} of {cameras.num_views}: its position is more than 16384 near from the mean position; "
                "correct near or the poses and encode again."
            )


def _depth_problems(near: float, far: float) -> Iterator[str]:
    for name, value in (("near", near), ("far", far)):
        if not _is_finite_float32(value):
            yield f"{name} is {value}, it must be a finite float32 value; correct the depth range and encode again."
    if not MIN_NEAR <= near <= MAX_NEAR:
        yield f"near is {near}, it must be 2^-40 to 2^40; choose another unit of length and encode again."
    if not near * MIN_DEPTH_RATIO <= far <= near * MAX_DEPTH_RATIO:
        yield (
            f"near is {near} and far is {far}, far must be 1.002 to 16384 times near; correct the depth range and "
            "encode again."
        )


def _view_problems(extrinsics: tuple[float, ...], intrinsics: tuple[float, ...]) -> Iterator[str]:
    if len(extrinsics) != 12 or len(intrinsics) != 4:
        yield f"it has {len(extrinsics)} and {len(intrinsics)} values; give 12 of the pose and 4 intrinsics."
    for name, value in zip(_COMPONENTS, (*extrinsics, *intrinsics), strict=False):
        if not _is_finite_float32(value):
            yield f"{name} is {value}, it must be a finite float32 value; correct the camera and encode again."
    yield from _pose_problems(extrinsics)
    for name, focal in zip(("fx", "fy"), intrinsics[:2], strict=True):
        if not MIN_FOCAL <= focal <= MAX_FOCAL:
            yield f"focal length {name} is {focal} image sides, it must be 2^-6 to 2^8; correct it and encode again."
    for name, centre in zip(("cx", "cy"), intrinsics[2:], strict=True):
        if abs(centre) > MAX_PRINCIPAL_POINT:
            yield f"principal point {name} is {centre} image sides, at most 2^8 may be; correct it and encode again."


def _pose_problems(pose: tuple[float, ...]) -> Iterator[str]:
    rows = (pose[0:3], pose[4:7], pose[8:11])
    if max(abs(value) for row in rows for value in row) > 2.0 or _orthonormality_error(rows) > ORTHONORMAL_TOLERANCE:
        yield "its rotation is not orthonormal within 0.001; give a rigid pose without scale and encode again."
    if _determinant(rows) < 0.0:
        yield "its pose is mirrored (determinant below 0); give OpenCV camera-to-world poses and encode again."
    if max(abs(value) for value in pose[3::4]) > MAX_COORDINATE:
        yield "its position is more than 2^60 from the origin; choose another unit of length and encode again."


def _orthonormality_error(rows: tuple[tuple[float, ...], ...]) -> float:
    """Return the largest magnitude of an element of R R^T - I."""
    return max(
        abs(first[0] * second[0] + first[1] * second[1] + first[2] * second[2] - (1.0 if i == j else 0.0))
        for i, first in enumerate(rows)
        for j, second in enumerate(rows)
    )


def _determinant(rows: tuple[tuple[float, ...], ...]) -> float:
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _is_finite_float32(value: float) -> bool:
    if not math.isfinite(value):
        return False
    try:
        rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return False
    return rounded == value
