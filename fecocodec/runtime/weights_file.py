"""Read tensors of bytes from a weights file, without torch."""

import json

import numpy as np
from jaxtyping import UInt8


def bytes_tensor(weights: bytes, name: str) -> UInt8[np.ndarray, "..."] | None:
    """Return a tensor of bytes (U8) of a weights file, without torch; None if the file has no tensor of this name.

    weights: a valid weights file (safetensors, ENTROPY.md, section 6.1).
    """
    size = int.from_bytes(weights[:8], "little")
    entry = json.loads(weights[8 : 8 + size]).get(name)
    if entry is None:
        return None
    begin, end = entry["data_offsets"]
    return np.frombuffer(weights[8 + size + begin : 8 + size + end], np.uint8).reshape(entry["shape"])
