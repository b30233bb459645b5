"""The fixed integer frequency tables of symbols: 64 zero-mean distributions, as data with a SHA-256.

Table k has the standard deviation 2^((k - 22) / 7): 0.11 (k = 0), 1 (k = 22), 58 (k = 63). All are scaled copies
of one mixture of two Gaussians, because latents have heavier tails than one Gaussian. Elements whose table is below
`FIRST_CODED_TABLE` are not coded: their symbol is 0 by rule.
"""

import hashlib
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from jaxtyping import UInt32

from fecocodec.errors import ModelError

NUM_TABLES = 64
TABLES_PER_OCTAVE = 7
SIGMA_ONE_INDEX = 22
# The mixture, in standard deviations of its table, fitted to symbols of training scenes (docs/what_we_learned.md).
WIDE_SHARE, WIDE_SIGMA = 0.125, 1.8
NARROW_SIGMA = math.sqrt((1.0 - WIDE_SHARE * WIDE_SIGMA**2) / (1.0 - WIDE_SHARE))  # 0.825: the mixture has variance 1
FIRST_CODED_TABLE = 6  # sigma 0.205; below it symbols are nearly always 0, and coding them hardly lowers the error
SYMBOL_LIMIT = 1 << 20  # largest magnitude of a symbol: the sender clamps to it, the receiver refuses more
FILE_NAME = "symbol_tables.bin"
SHA256 = "b48cf11ed8025fa24296cda054e9917eb96d004be7d83b91395714867feb34c2"


@dataclass(frozen=True)
class Table:
    """Frequencies of the symbols -reach..reach and, last, of the escape; all at least 1, their sum is 2^24."""

    reach: int
    frequencies: UInt32[np.ndarray, " entry"]

    @property
    def escape(self) -> int:
        """Index of the escape's entry; a symbol s within reach has entry s + reach."""
        return 2 * self.reach + 1


def parse_tables(data: bytes) -> tuple[Table, ...]:
    """Parse the bytes of the data file. Raises ModelError if their SHA-256 is not that of this version."""
    digest = hashlib.sha256(data).hexdigest()
    if digest != SHA256:
        raise ModelError(
            f"{FILE_NAME}: SHA-256 is {digest[:16]}..., this version needs {SHA256[:16]}...; reinstall the package."
        )
    tables, offset = [], 0
    for _ in range(NUM_TABLES):
        reach = int.from_bytes(data[offset : offset + 2], "little")
        frequencies = np.frombuffer(data, dtype="<u4", count=2 * reach + 2, offset=offset + 2)
        tables.append(Table(reach, frequencies.astype(np.uint32)))
        offset += 2 + frequencies.nbytes
    return tuple(tables)


@cache
def load_tables() -> tuple[Table, ...]:
    """Return the tables that ship with the package, read once. Raises ModelError if the file is damaged."""
    return parse_tables(files("fecocodec.entropy").joinpath(FILE_NAME).read_bytes())
