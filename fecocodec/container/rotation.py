"""Lossless coding of a float32 rotation matrix as three values and six small differences (FORMAT.md, section 6.2).

Three elements determine a rotation up to signs and rounding. They are stored, and predict the other six, which are
stored as differences from their predictions. Every step is one IEEE binary64 operation, so that all readers compute
the same predictions.
"""

import math
import struct
from collections.abc import Sequence

_FLOAT32 = struct.Struct("<f")
_WORD = struct.Struct("<I")
_SIGN = 0x80000000
_MAGNITUDE = 0x7FFFFFFF
_LARGEST_PREDICTION = 1.5  # elements of a rotation are at most 1; the comparison also rejects NaN


def rotation_to_words(rotation: Sequence[float]) -> tuple[int, ...]:
    """Return nine 32-bit words of nine float32 values, row-major.

    The words are r20, r21, r10, then the differences of r22, r00, r01, r11, r02, r12.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    return (
        float_to_word(r20),
        float_to_word(r21),
        float_to_word(r10),
        _difference(r22, _predict_r22(r20, r21)),
        _difference(r00, _predict_r00(r20, r10)),
        _difference(r01, _predict_r01(r00, r10, r20, r21, r22)),
        _difference(r11, _predict_r11(r00, r10, r20, r21, r22)),
        _difference(r02, r10 * r21 - r20 * r11),
        _difference(r12, r20 * r01 - r00 * r21),
    )


def rotation_from_words(words: Sequence[int]) -> tuple[float, ...]:
    """Invert `rotation_to_words`. Any nine words give nine float32 values, not necessarily a rotation."""
    r20, r21, r10 = (word_to_float(word) for word in words[:3])
    d22, d00, d01, d11, d02, d12 = words[3:]
    r22 = _add_difference(_predict_r22(r20, r21), d22)
    r00 = _add_difference(_predict_r00(r20, r10), d00)
    r01 = _add_difference(_predict_r01(r00, r10, r20, r21, r22), d01)
    r11 = _add_difference(_predict_r11(r00, r10, r20, r21, r22), d11)
    r02 = _add_difference(r10 * r21 - r20 * r11, d02)
    r12 = _add_difference(r20 * r01 - r00 * r21, d12)
    return r00, r01, r02, r10, r11, r12, r20, r21, r22


def float_to_word(value: float) -> int:
    """Return the bits of a float32 value as an unsigned integer."""
    word: int = _WORD.unpack(_FLOAT32.pack(value))[0]
    return word


def word_to_float(word: int) -> float:
    """Return the float32 value with these 32 bits."""
    value: float = _FLOAT32.unpack(_WORD.pack(word))[0]
    return value


def _predict_r22(r20: float, r21: float) -> float:
    """Predict from the unit length of the last row; the difference carries the sign."""
    return _root(1.0 - r20 * r20 - r21 * r21)


def _predict_r00(r20: float, r10: float) -> float:
    """Predict from the unit length of the first column; the difference carries the sign."""
    return _root(1.0 - r20 * r20 - r10 * r10)


def _predict_r01(r00: float, r10: float, r20: float, r21: float, r22: float) -> float:
    return -_ratio(r10 * r22 + r00 * r20 * r21, r00 * r00 + r10 * r10)


def _predict_r11(r00: float, r10: float, r20: float, r21: float, r22: float) -> float:
    return _ratio(r00 * r22 - r10 * r20 * r21, r00 * r00 + r10 * r10)


def _root(square: float) -> float:
    return math.sqrt(square) if square > 0.0 else 0.0


def _ratio(numerator: float, denominator: float) -> float:
    return numerator / denominator if denominator > 0.0 else 0.0


def _prediction_word(prediction: float) -> int:
    """Return the bits of the prediction in float32; +0 if its magnitude is impossible for an element of a rotation."""
    if not abs(prediction) <= _LARGEST_PREDICTION:
        return 0
    word = float_to_word(prediction)
    return word if word & _MAGNITUDE else 0


def _difference(value: float, prediction: float) -> int:
    """Return the difference of the magnitude bits modulo 2^31, zigzag-coded; bit 0 is 1 if the signs differ."""
    actual, predicted = float_to_word(value), _prediction_word(prediction)
    magnitude = ((actual & _MAGNITUDE) - (predicted & _MAGNITUDE)) & _MAGNITUDE
    zigzag = 2 * magnitude if magnitude < 1 << 30 else 2 * ((1 << 31) - magnitude) - 1
    return zigzag << 1 | (actual ^ predicted) >> 31


def _add_difference(prediction: float, difference: int) -> float:
    """Invert `_difference`."""
    predicted = _prediction_word(prediction)
    zigzag = difference >> 1
    magnitude = -(zigzag + 1 >> 1) if zigzag & 1 else zigzag >> 1
    sign = (predicted ^ difference << 31) & _SIGN
    return word_to_float(((predicted & _MAGNITUDE) + magnitude) & _MAGNITUDE | sign)
