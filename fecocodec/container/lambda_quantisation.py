"""Quantisation of lambda, the weight of the rate in D + lambda R.

Streams carry the logarithm of lambda as an integer, lambda_q, on which the networks are conditioned.
"""

import math

from fecocodec.errors import InputError

LAMBDA_MIN = 1e-5
LAMBDA_MAX = 1e-2
STEPS_PER_E = 256  # steps of lambda_q per factor e
LAMBDA_Q_MAX = 1768  # round(256 * ln(LAMBDA_MAX / LAMBDA_MIN))


def quantise_lambda(lmbda: float) -> int:
    """Return lambda_q = `round(256 * ln(lambda / 1e-5))` of a lambda in [1e-5, 1e-2]. Raises InputError for others."""
    if not LAMBDA_MIN <= lmbda <= LAMBDA_MAX:
        raise InputError(
            f"lambda is {lmbda}, outside the range of the codec; choose one from {LAMBDA_MIN} to {LAMBDA_MAX}."
        )
    return round(STEPS_PER_E * math.log(lmbda / LAMBDA_MIN))


def dequantise_lambda(lambda_q: int) -> float:
    """Return lambda = `1e-5 * exp(lambda_q / 256)` of an integer in [0, 1768]. Raises InputError for others."""
    if not 0 <= lambda_q <= LAMBDA_Q_MAX:
        raise InputError(f"quantised lambda is {lambda_q}, outside its range; choose one from 0 to {LAMBDA_Q_MAX}.")
    return LAMBDA_MIN * math.exp(lambda_q / STEPS_PER_E)
