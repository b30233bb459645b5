"""Write `symbol_tables.bin`: `python -m fecocodec.entropy.make_tables FILE`, by hand, when the format changes.

The tables are data: the file ships, and `tables.py` only reads it. A change of one byte is a change of the format.
"""

import math
import sys
from pathlib import Path

import numpy as np

from fecocodec.entropy.tables import (
    NARROW_SIGMA,
    NUM_TABLES,
    PRECISION_BITS,
    SIGMA_ONE_INDEX,
    TABLES_PER_OCTAVE,
    WIDE_SHARE,
    WIDE_SIGMA,
)

_TOTAL = 1 << PRECISION_BITS
_REACH_IN_SIGMAS = 8.0
_LEAST_FREQUENCY = 16  # an outlier within the table costs at most 20 bits
_LEAST_ESCAPE_FREQUENCY = 256  # an escape costs 16 bits plus its own code; reserving it costs 0.00002 bits a symbol


def _upper_tail(distance_in_sigmas: float) -> float:
    """Probability that the mixture of standard deviation 1 exceeds this value."""
    narrow = math.erfc(distance_in_sigmas / (NARROW_SIGMA * math.sqrt(2.0)))
    wide = math.erfc(distance_in_sigmas / (WIDE_SIGMA * math.sqrt(2.0)))
    return 0.5 * ((1.0 - WIDE_SHARE) * narrow + WIDE_SHARE * wide)


def frequencies_of(sigma: float) -> list[int]:
    """Return the integer frequencies of the symbols -reach..reach and, last, of the escape. They sum to 2^24."""
    reach = math.ceil(_REACH_IN_SIGMAS * sigma) + 1
    escape = _LEAST_ESCAPE_FREQUENCY + round(2.0 * _upper_tail((reach + 0.5) / sigma) * _TOTAL)
    to_share = _TOTAL - escape - (2 * reach + 1) * _LEAST_FREQUENCY
    half = []
    for magnitude in range(reach, 0, -1):
        mass = _upper_tail((magnitude - 0.5) / sigma) - _upper_tail((magnitude + 0.5) / sigma)
        half.append(_LEAST_FREQUENCY + math.floor(mass * to_share))
    centre = _TOTAL - 2 * sum(half) - escape
    return [*half, centre, *reversed(half), escape]


def serialise_tables() -> bytes:
    """Return the file's bytes: per table, reach as uint16 and 2 * reach + 2 frequencies as uint32, little-endian."""
    parts = []
    for index in range(NUM_TABLES):
        frequencies = frequencies_of(2.0 ** ((index - SIGMA_ONE_INDEX) / TABLES_PER_OCTAVE))
        parts.append(np.uint16((len(frequencies) - 2) // 2).astype("<u2").tobytes())
        parts.append(np.array(frequencies, dtype="<u4").tobytes())
    return b"".join(parts)


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(serialise_tables())
