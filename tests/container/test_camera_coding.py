"""Camera coding is lossless, and rotations take much less than nine float32 values."""

import math

from hypothesis import given
from hypothesis import strategies as st

from fecocodec.container import PackedCameras
from fecocodec.container.cameras import pack_cameras, unpack_cameras
from fecocodec.container.rotation import float_to_word, rotation_from_words, rotation_to_words
from tests.container.example_streams import float32, pose

any_float32 = st.floats(width=32, allow_nan=False)


@given(st.tuples(*[any_float32] * 9))
def test_any_nine_values_come_back_with_the_same_bits(values: tuple[float, ...]) -> None:
    """Includes values that are not a rotation: infinities, subnormal numbers and zeros of both signs."""
    received = rotation_from_words(rotation_to_words(values))
    assert [float_to_word(value) for value in received] == [float_to_word(value) for value in values]


def yaw_pitch(yaw: float, pitch: float) -> tuple[float, ...]:
    c, s, d, e = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    return tuple(float32(value) for value in (c, s * e, s * d, 0.0, d, -e, -s, c * e, c * d))


def test_the_axis_aligned_rotation_costs_nothing_but_zeros() -> None:
    assert rotation_to_words((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)) == (0,) * 9


@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))
def test_predicted_elements_are_off_by_few_float32_steps(yaw: float, pitch: float) -> None:
    """The square root of a small difference is ill-conditioned, so angles near 90 degrees are excluded."""
    words = rotation_to_words(yaw_pitch(yaw, pitch))
    roots, rest = words[3:5], words[5:]
    assert all(word < 1 << 10 for word in roots)
    assert sum(word < 1 << 16 for word in rest) >= 2


def test_eight_cameras_take_less_than_seven_tenths_of_their_floats() -> None:
    poses = tuple(
        pose(yaw_pitch(0.3 * view - 1.0, 0.1 * view - 0.3), (math.sin(view), math.cos(2 * view), 0.1 * view))
        for view in range(8)
    )
    lens = tuple(float32(value) for value in (0.87, 1.55, 0.4981, 0.5033))
    cameras = PackedCameras(poses, (lens,) * 8, float32(0.731), float32(37.21))
    payload = pack_cameras(cameras)
    assert unpack_cameras(payload, 8, "section cameras") == cameras
    assert len(payload) < 0.7 * 4 * (8 * 12 + 4 + 2)


@given(st.tuples(*[any_float32] * 12), st.tuples(*[any_float32] * 4))
def test_packing_keeps_values_of_any_size(extrinsics: tuple[float, ...], lens: tuple[float, ...]) -> None:
    cameras = PackedCameras((extrinsics, extrinsics[::-1]), (lens, lens[::-1]), 1.0, 2.0)
    assert unpack_cameras(pack_cameras(cameras), 2, "section cameras") == cameras
