"""The decoder of ENTROPY.md, sections 2 and 3, in plain integers."""

import numpy as np

from fecocodec.entropy.tables import FIRST_CODED_TABLE, load_tables


class ReferenceAns:
    def __init__(self, payload: bytes) -> None:
        self.words = [int.from_bytes(payload[i : i + 4], "little") for i in range(0, len(payload), 4)]
        self.state = 0
        self._refill()
        self._refill()

    def _refill(self) -> None:
        if self.state < 1 << 32 and self.words:
            self.state = self.state << 32 | self.words.pop()

    def take(self, frequencies: list[int]) -> int:
        slot, entry = self.state & 0xFFFFFF, 0
        while slot >= frequencies[entry]:
            slot -= frequencies[entry]
            entry += 1
        self._advance(frequencies[entry], slot)
        return entry

    def take_uniform(self, bits: int) -> int:
        frequency = 1 << (24 - bits)
        entry, offset = divmod(self.state & 0xFFFFFF, frequency)
        self._advance(frequency, offset)
        return entry

    def _advance(self, frequency: int, offset: int) -> None:
        self.state = (self.state >> 24) * frequency + offset
        self._refill()

    def is_empty(self) -> bool:
        return self.state == 0 and not self.words


def decode_batch(ans: ReferenceAns, table_index: np.ndarray) -> np.ndarray:
    tables = [int(t) for t in table_index.ravel()]
    order = sorted((i for i, t in enumerate(tables) if t >= FIRST_CODED_TABLE), key=lambda i: (tables[i], i))
    symbols = [0] * len(tables)
    escaped = []
    for i in order:
        table = load_tables()[tables[i]]
        entry = ans.take(table.frequencies.tolist())
        symbols[i] = entry - table.reach
        if entry == table.escape:
            escaped.append(i)
    exponents = [ans.take_uniform(5) for _ in escaped]
    for i, exponent in zip(escaped, exponents, strict=True):
        mantissa = ans.take_uniform(exponent + 1)
        magnitude = load_tables()[tables[i]].reach + (1 << exponent) + (mantissa >> 1)
        symbols[i] = -magnitude if mantissa & 1 else magnitude
    return np.array(symbols).reshape(table_index.shape)
