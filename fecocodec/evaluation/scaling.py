"""Scaling study: time, memory and file size against the number of views and pixels, on a synthetic room."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.memory import forget_peak, peak_mib, return_freed_memory
from fecocodec.evaluation.stress.box_room import Room, painted, photograph
from fecocodec.evaluation.stress.camera_paths import along_a_line
from fecocodec.receiver.decode import decode_with
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with

LAMBDA = 1e-3
REPEAT_BELOW = 2**18  # pixels of all views below which a measurement is repeated and the minimum is taken
REPEATS = 3


@dataclass(frozen=True)
class Load:
    """One measurement. side: image side in pixels. pixels: of all views. peak_mib: resident memory, None if unknown."""

    num_views: int
    side: int
    pixels: int
    encode_seconds: float
    decode_seconds: float
    peak_mib: float | None
    num_bytes: int


def measure_load(codec: Codec, num_views: int, side: int) -> Load:
    """Encode and decode `num_views` square views of the textured room. side: image side in pixels."""
    poses = along_a_line(num_views)[:num_views]
    views = photograph(Room(painted), poses, (side, side))
    lambda_q, pixels = quantise_lambda(LAMBDA), num_views * side * side
    return_freed_memory()  # of a previous, larger measurement
    forget_peak()
    encode_seconds, decode_seconds = [], []
    for _ in range(REPEATS if pixels < REPEAT_BELOW else 1):
        begin = perf_counter()
        data = encode_with(codec, views, lambda_q)
        encoded = perf_counter()
        decode_with(codec.receiver, data)
        encode_seconds.append(encoded - begin)
        decode_seconds.append(perf_counter() - encoded)
    return Load(num_views, side, pixels, min(encode_seconds), min(decode_seconds), peak_mib(), len(data))


def exponent(amounts: list[float], costs: list[float]) -> float | None:
    """Return the least-squares slope of log(cost) over log(amount); 1 is proportional.

    Returns None for fewer than two different amounts.
    """
    if len(set(amounts)) < 2:
        return None
    return float(np.polyfit(np.log(amounts), np.log(costs), 1)[0])
