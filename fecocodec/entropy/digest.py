"""A fingerprint of decoded symbols: shows that both ends have the same, whatever happened in between."""

import hashlib
from collections.abc import Iterable

import numpy as np
from jaxtyping import Int

DIGEST_BYTES = 8


def symbol_digest(batches: Iterable[Int[np.ndarray, "..."]]) -> bytes:
    """BLAKE2b, 8 bytes, of all symbols in coding order as little-endian int32, those that are 0 by rule included."""
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for batch in batches:
        digest.update(np.ascontiguousarray(batch, dtype="<i4").tobytes())
    return digest.digest()
