"""Camera coding is lossless; its bytes are those of the vectors.

Quantisation of lambda: the whole range, its limits, and values outside.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fecocodec.container import LAMBDA_Q_MAX, PackedCameras, dequantise_lambda, quantise_lambda
from fecocodec.container.cameras import pack_cameras, unpack_cameras
from fecocodec.errors import InputError

any_float32 = st.floats(width=32, allow_nan=False)


@given(st.tuples(*[any_float32] * 12), st.tuples(*[any_float32] * 4))
def test_packing_keeps_values_of_any_size(extrinsics: tuple[float, ...], lens: tuple[float, ...]) -> None:
    """Also of what is no rotation, infinities, subnormal numbers and zeros of both signs."""
    cameras = PackedCameras((extrinsics, extrinsics[::-1]), (lens, lens[::-1]), 1.0, 2.0)
    assert repr(unpack_cameras(pack_cameras(cameras), 2, "section cameras")) == repr(cameras)


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
