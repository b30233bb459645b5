"""Symbols <-> bytes, in one routine for both directions. Only this file imports constriction.

A symbol coder codes one batch of symbols at a time. Within a batch, elements are grouped by table (ascending, stable),
which is several times faster than coding them in order; the batch's escapes follow (`bitstream_spec/ENTROPY.md`,
section 3).
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Iterable
from functools import cache
from itertools import pairwise
from typing import Any, TypeAlias

import constriction
import numpy as np
from jaxtyping import Int, Int32, Integer

from fecocodec.entropy.tables import FIRST_CODED_TABLE, SYMBOL_LIMIT, load_tables
from fecocodec.errors import BitstreamError

_EXPONENT_CLASSES = 32
_HIGHEST_EXPONENT = SYMBOL_LIMIT.bit_length() - 2  # an escape's excess is below 2^20

_Model: TypeAlias = Any  # constriction carries no types


def symbol_digest(batches: Iterable[Int[np.ndarray, "..."]]) -> bytes:
    """Return the 8-byte BLAKE2b digest of all symbols in coding order, as little-endian int32.

    Symbols that are not coded, because they are 0 by rule, are included.
    """
    digest = hashlib.blake2b(digest_size=8)  # as the header holds
    for batch in batches:
        digest.update(np.ascontiguousarray(batch, dtype="<i4").tobytes())
    return digest.digest()


@cache
def _table_model(table_index: int) -> _Model:
    # constriction gives entry i the frequency 1 + p_i * (2^24 - entries) / sum(p), up to rounding: with these p the
    # factor is 1 and every sum an integer, so the frequencies are exactly those of the table.
    weights = load_tables()[table_index].frequencies.astype(np.float64) - 1.0
    return constriction.stream.model.Categorical(weights, lazy=False, perfect=False)


class SymbolCoder(ABC):
    """Codes symbols; `SymbolWriter` and `SymbolReader` differ only in `_code` and `_code_uniform`."""

    def exchange(
        self, table_index: Integer[np.ndarray, "*shape"], wanted: Int[np.ndarray, "*shape"] | None
    ) -> Int32[np.ndarray, "*shape"]:
        """Code one batch and return its symbols, equal at both ends.

        table_index: in [0, 64); below FIRST_CODED_TABLE nothing is coded and the symbol is 0. wanted: the symbols to
        write, clamped to +-2^20; a reader ignores it. Raises BitstreamError if a reader decodes an impossible value.
        """
        tables = table_index.ravel()
        order = np.argsort(tables.astype(np.uint8), kind="stable")  # of bytes: a radix sort
        order = order[np.count_nonzero(tables < FIRST_CODED_TABLE) :]
        symbols = np.zeros(tables.size, dtype=np.int32)
        if order.size:
            chosen = None if wanted is None else wanted.ravel()[order].clip(-SYMBOL_LIMIT, SYMBOL_LIMIT)
            symbols[order] = self._exchange_grouped(tables[order], chosen)
        return symbols.reshape(table_index.shape)

    @abstractmethod
    def _code(self, model: _Model, wanted: np.ndarray | None, count: int) -> np.ndarray:
        """Code `count` entries with one model; wanted: the entries to write."""

    @abstractmethod
    def _code_uniform(self, wanted: np.ndarray | None, sizes: np.ndarray) -> np.ndarray:
        """Code entries uniform in [0, size), one size per entry; wanted: the entries to write."""

    def _exchange_grouped(self, tables: np.ndarray, wanted: np.ndarray | None) -> np.ndarray:
        symbols = np.empty(tables.size, dtype=np.int64)
        reaches = np.empty(tables.size, dtype=np.int64)
        bounds = [0, *(np.flatnonzero(np.diff(tables)) + 1).tolist(), tables.size]
        for begin, end in pairwise(bounds):
            index = int(tables[begin])
            reach, escape = load_tables()[index].reach, load_tables()[index].escape
            entries = None
            if wanted is not None:
                entries = np.where(np.abs(wanted[begin:end]) <= reach, wanted[begin:end] + reach, escape)
            symbols[begin:end] = self._code(_table_model(index), entries, end - begin) - reach
            reaches[begin:end] = reach
        escaped = np.flatnonzero(symbols > reaches)
        if escaped.size:
            symbols[escaped] = self._exchange_escapes(reaches[escaped], None if wanted is None else wanted[escaped])
        return symbols

    def _exchange_escapes(self, reaches: np.ndarray, wanted: np.ndarray | None) -> np.ndarray:
        exponents, mantissas = None, None
        if wanted is not None:
            excess = np.abs(wanted) - reaches
            exponents = np.frexp(excess.astype(np.float64))[1] - 1  # floor(log2(excess)), exact
            mantissas = (excess - (1 << exponents)) * 2 + (wanted < 0)
        exponents = self._code(constriction.stream.model.Uniform(_EXPONENT_CLASSES), exponents, reaches.size)
        if exponents.max() > _HIGHEST_EXPONENT:
            raise BitstreamError(
                f"payload: an escape has the exponent {exponents.max()}, at most {_HIGHEST_EXPONENT} is allowed; "
                "the payload is damaged."
            )
        mantissas = self._code_uniform(mantissas, 2 << exponents)
        magnitudes = reaches + (1 << exponents) + (mantissas >> 1)
        if magnitudes.max() > SYMBOL_LIMIT:
            raise BitstreamError(
                f"payload: a symbol is {magnitudes.max()} in magnitude, at most {SYMBOL_LIMIT} is allowed; "
                "the payload is damaged."
            )
        symbols: np.ndarray = np.where(mantissas & 1, -magnitudes, magnitudes)
        return symbols


class SymbolWriter(SymbolCoder):
    """Collects symbols; `finish` returns the payload. ANS is a stack, so all symbols are coded at the end, reversed."""

    def __init__(self) -> None:
        self._pending: list[tuple[np.ndarray, _Model, tuple[np.ndarray, ...]]] = []

    def _code(self, model: _Model, wanted: np.ndarray | None, count: int) -> np.ndarray:
        return self._push(wanted, model)

    def _code_uniform(self, wanted: np.ndarray | None, sizes: np.ndarray) -> np.ndarray:
        return self._push(wanted, constriction.stream.model.Uniform(), sizes.astype(np.int32))

    def _push(self, wanted: np.ndarray | None, model: _Model, *parameters: np.ndarray) -> np.ndarray:
        if wanted is None:
            raise ValueError("SymbolWriter.exchange: wanted is None; pass the symbols to write.")
        self._pending.append((wanted.astype(np.int32), model, parameters))
        return wanted.astype(np.int64)

    def finish(self) -> bytes:
        """Return the payload: little-endian 32-bit words."""
        coder = constriction.stream.stack.AnsCoder()
        for entries, model, parameters in reversed(self._pending):
            coder.encode_reverse(entries, model, *parameters)
        words: np.ndarray = coder.get_compressed()
        return words.astype("<u4").tobytes()


class SymbolReader(SymbolCoder):
    """Decodes a payload, in the same batches in which it was written."""

    def __init__(self, payload: bytes) -> None:
        """Raises BitstreamError if the payload's length or last word is impossible."""
        if len(payload) % 4 or payload[-4:] == bytes(4):
            raise BitstreamError(
                f"payload: its {len(payload)} bytes are not 32-bit words of which the last is not zero; "
                "the payload is damaged."
            )
        self._coder = constriction.stream.stack.AnsCoder(np.frombuffer(payload, dtype="<u4").astype(np.uint32))

    def _code(self, model: _Model, wanted: np.ndarray | None, count: int) -> np.ndarray:
        entries: np.ndarray = self._coder.decode(model, count)
        return entries.astype(np.int64)

    def _code_uniform(self, wanted: np.ndarray | None, sizes: np.ndarray) -> np.ndarray:
        entries: np.ndarray = self._coder.decode(constriction.stream.model.Uniform(), sizes.astype(np.int32))
        return entries.astype(np.int64)

    def finish(self) -> None:
        """Raises BitstreamError unless the payload was consumed exactly."""
        if not self._coder.is_empty():
            raise BitstreamError("payload: its symbols and its bytes do not end together; the payload is damaged.")
