"""Camera coding is lossless, and rotations take much less than nine float32 values.

Quantisation of lambda: the whole range, its limits, and values outside.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fecocodec.container import LAMBDA_Q_MAX, PackedCameras, dequantise_lambda, quantise_lambda
from fecocodec.container.cameras import pack_cameras, unpack_cameras
from fecocodec.container.rotation import float_to_word, rotation_from_words, rotation_to_words
from fecocodec.errors import InputError
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


def test_integers_of_lambda() -> None:
    assert quantise_lambda(1e-5) == 0
    assert quantise_lambda(1e-2) == LAMBDA_Q_MAX == 1768
    assert dequantise_lambda(0) == 1e-5
    assert [quantise_lambda(dequantise_lambda(q)) for q in range(LAMBDA_Q_MAX + 1)] == list(range(LAMBDA_Q_MAX + 1))


@given(st.floats(1e-5, 1e-2))
def test_lambda_is_kept_within_two_tenths_of_a_percent(lmbda: float) -> None:
    assert math.isclose(dequantise_lambda(quantise_lambda(lmbda)), lmbda, rel_tol=0.002)


@pytest.mark.parametrize("lmbda", [0.0, -1e-3, 9.9e-6, 0.0101, math.inf, math.nan])
def test_a_lambda_outside_the_range_is_refused(lmbda: float) -> None:
    with pytest.raises(InputError, match=r"choose one from 1e-05 to 0\.01"):
        quantise_lambda(lmbda)


@pytest.mark.parametrize("lambda_q", [-1, 1769])
def test_an_integer_outside_the_range_is_refused(lambda_q: int) -> None:
    with pytest.raises(InputError, match="choose one from 0 to 1768"):
        dequantise_lambda(lambda_q)
