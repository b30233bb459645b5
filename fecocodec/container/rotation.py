"""Nine float32 of a rotation matrix as three values and six small differences, without loss (FORMAT.md, section 6.2).

A rotation follows from part of one row and one column; what rounding (or a matrix that is not quite a rotation) adds is
sent as a difference. Every step is one IEEE binary64 operation, so all readers predict the same float32.
"""

import math
import struct
from collections.abc import Sequence

_FLOAT32 = struct.Struct("<f")
_WORD = struct.Struct("<I")
_SIGN = 0x80000000
_MAGNITUDE = 0x7FFFFFFF
_LARGEST_PREDICTION = 1.5  # no element of a rotation is larger, whatever the rounding; also catches NaN


def rotation_to_words(rotation: Sequence[float]) -> tuple[int, ...]:
    """Nine float32 values, row-major, as nine 32-bit words: r20 r21 r10, then differences r22 r00 r01 r11 r02 r12."""
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
    """The nine float32 values, row-major, of the words made by `rotation_to_words`; any nine words give some values."""
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
    """The bits of a float32 value."""
    word: int = _WORD.unpack(_FLOAT32.pack(value))[0]
    return word


def word_to_float(word: int) -> float:
    """The float32 value of 32 bits."""
    value: float = _FLOAT32.unpack(_WORD.pack(word))[0]
    return value


def _predict_r22(r20: float, r21: float) -> float:
    """From the unit length of the last row; the sign travels with the difference."""
    return _root(1.0 - r20 * r20 - r21 * r21)


def _predict_r00(r20: float, r10: float) -> float:
    """From the unit length of the first column; the sign travels with the difference."""
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
    """Bits of the prediction rounded to float32; +0 where it is no possible element of a rotation."""
    if not abs(prediction) <= _LARGEST_PREDICTION:
        return 0
    word = float_to_word(prediction)
    return word if word & _MAGNITUDE else 0


def _difference(value: float, prediction: float) -> int:
    """Magnitudes subtracted modulo 2^31, zigzag-coded, above one bit that says whether the signs differ."""
    actual, predicted = float_to_word(value), _prediction_word(prediction)
    magnitude = ((actual & _MAGNITUDE) - (predicted & _MAGNITUDE)) & _MAGNITUDE
    zigzag = 2 * magnitude if magnitude < 1 << 30 else 2 * ((1 << 31) - magnitude) - 1
    return zigzag << 1 | (actual ^ predicted) >> 31


def _add_difference(prediction: float, difference: int) -> float:
    predicted = _prediction_word(prediction)
    zigzag = difference >> 1
    magnitude = -(zigzag + 1 >> 1) if zigzag & 1 else zigzag >> 1
    sign = (predicted ^ difference << 31) & _SIGN
    return word_to_float(((predicted & _MAGNITUDE) + magnitude) & _MAGNITUDE | sign)
