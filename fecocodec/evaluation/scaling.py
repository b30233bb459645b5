"""How time, memory and bytes grow with the number of views and with their pixels, in a room that is drawn."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.memory import forget_peak, give_back_freed_memory, peak_mib
from fecocodec.evaluation.stress.box_room import Room, painted, photograph
from fecocodec.evaluation.stress.camera_paths import along_a_line
from fecocodec.receiver.decode import decode_with
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with

LAMBDA = 1e-3
REPEAT_BELOW = 2**18  # pixels of all views: shorter measurements are repeated, the fastest counts
REPEATS = 3


@dataclass(frozen=True)
class Load:
    """One measurement. pixels: of all views."""

    num_views: int
    side: int
    pixels: int
    encode_seconds: float
    decode_seconds: float
    peak_mib: float | None
    num_bytes: int


def measure_load(codec: Codec, num_views: int, side: int) -> Load:
    """Encode and decode so many square views of the painted room."""
    poses = along_a_line(num_views)[:num_views]
    views = photograph(Room(painted), poses, (side, side))
    lambda_q, pixels = quantise_lambda(LAMBDA), num_views * side * side
    give_back_freed_memory()  # of a larger load before
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
    """Slope of log(cost) over log(amount) by least squares: 1 is proportional. None for fewer than two amounts."""
    if len(set(amounts)) < 2:
        return None
    return float(np.polyfit(np.log(amounts), np.log(costs), 1)[0])
