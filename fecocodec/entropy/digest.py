"""Digest of the symbols of a stage, which sender and receiver compare."""

import hashlib
from collections.abc import Iterable

import numpy as np
from jaxtyping import Int

DIGEST_BYTES = 8


def symbol_digest(batches: Iterable[Int[np.ndarray, "..."]]) -> bytes:
    """Return the 8-byte BLAKE2b digest of all symbols in coding order, as little-endian int32.

    Symbols that are not coded, because they are 0 by rule, are included.
    """
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for batch in batches:
        digest.update(np.ascontiguousarray(batch, dtype="<i4").tobytes())
    return digest.digest()
