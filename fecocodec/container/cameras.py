"""The camera section: the cameras of all views as float32 values, compressed losslessly (FORMAT.md, section 6)."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from fecocodec.container.deflate import deflate, inflate
from fecocodec.container.rotation import float_to_word, rotation_from_words, rotation_to_words, word_to_float
from fecocodec.errors import BAD_WRITER, BitstreamError

_NUM_ROTATION_WORDS = 9

_Component = TypeVar("_Component", int, float)


@dataclass(frozen=True)
class PackedCameras:
    """Cameras as a stream stores them; every value is exactly representable in float32.

    extrinsics: per view the top three rows of the camera-to-world matrix, row-major, OpenCV axes, scene units.
    intrinsics: per view (fx, fy, cx, cy), divided by image width (fx, cx) and height (fy, cy).
    near, far: bounds of depth in scene units.
    """

    extrinsics: tuple[tuple[float, ...], ...]
    intrinsics: tuple[tuple[float, ...], ...]
    near: float
    far: float

    @property
    def num_views(self) -> int:
        return len(self.extrinsics)


def pack_cameras(cameras: PackedCameras) -> bytes:
    """Return the payload of the camera section. The caller must have validated the cameras (`check_cameras`)."""
    shared = len(set(cameras.intrinsics)) == 1
    intrinsics = cameras.intrinsics[:1] if shared else cameras.intrinsics
    rotations = (rotation_to_words([row[i] for i in (0, 1, 2, 4, 5, 6, 8, 9, 10)]) for row in cameras.extrinsics)
    words = [float_to_word(value) for value in (cameras.near, cameras.far)]
    words += [float_to_word(value) for value in _by_component(intrinsics)]
    words += _by_component(list(rotations))
    words += [float_to_word(value) for value in _by_component([row[3::4] for row in cameras.extrinsics])]
    raw = struct.pack(f">{len(words)}I", *words)
    planes = b"".join(raw[byte::4] for byte in range(4))
    return deflate(bytes([len(intrinsics)]) + planes)


def unpack_cameras(payload: bytes, num_views: int, place: str) -> PackedCameras:
    """Parse the payload of the camera section of a stream with `num_views` views.

    Raises BitstreamError, whose message starts with `place`, if the payload does not hold exactly `num_views` cameras.
    The values are not validated here; call `check_cameras`.
    """
    content = inflate(payload, _content_size(num_views, num_views), place)
    num_intrinsics = content[0] if content else 0
    if num_intrinsics not in (1, num_views):
        raise BitstreamError(
            f"{place}: it holds {num_intrinsics} sets of intrinsics for {num_views} views, allowed are 1 and "
            f"{num_views}; {BAD_WRITER}"
        )
    expected = _content_size(num_views, num_intrinsics)
    if len(content) != expected:
        raise BitstreamError(
            f"{place}: it inflates to {len(content)} bytes, {num_views} views need {expected}; {BAD_WRITER}"
        )
    words = _words_of_planes(content[1:])
    near, far = (word_to_float(word) for word in words[:2])
    pose_start = 2 + 4 * num_intrinsics
    position_start = pose_start + _NUM_ROTATION_WORDS * num_views
    intrinsics = _by_view([word_to_float(word) for word in words[2:pose_start]], num_intrinsics)
    rotations = [rotation_from_words(view) for view in _by_view(words[pose_start:position_start], num_views)]
    translations = _by_view([word_to_float(word) for word in words[position_start:]], num_views)
    extrinsics = tuple(
        r[0:3] + t[0:1] + r[3:6] + t[1:2] + r[6:9] + t[2:3] for r, t in zip(rotations, translations, strict=True)
    )
    return PackedCameras(extrinsics, intrinsics * (num_views // num_intrinsics), near, far)


def _content_size(num_views: int, num_intrinsics: int) -> int:
    return 1 + 4 * (2 + 4 * num_intrinsics + (3 + _NUM_ROTATION_WORDS) * num_views)


def _by_component(views: Sequence[Sequence[_Component]]) -> list[_Component]:
    """Return the first component of every view, then the second of every view, and so on.

    Adjacent values are similar in this order, so that Deflate compresses them better.
    """
    return [view[component] for component in range(len(views[0])) for view in views]


def _by_view(components: Sequence[_Component], num_views: int) -> tuple[tuple[_Component, ...], ...]:
    """Invert `_by_component`."""
    return tuple(tuple(components[view::num_views]) for view in range(num_views))


def _words_of_planes(planes: bytes) -> tuple[int, ...]:
    """Return the 32-bit words of four byte planes, the most significant plane first."""
    count = len(planes) // 4
    raw = bytearray(len(planes))
    for byte in range(4):
        raw[byte::4] = planes[byte * count : (byte + 1) * count]
    return struct.unpack(f">{count}I", raw)
