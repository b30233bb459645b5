"""Report section: time, memory and file size of a synthetic room against the number of pixels and views."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.machine import forget_peak, peak_mib
from fecocodec.evaluation.report.section import Chart, Mark, Section, Series, number, picture, table
from fecocodec.evaluation.stress.box_room import Room, along_a_line, painted, photograph
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
    """Return the least-squares slope of log(cost) over log(amount), 1 if proportional; None for a single amount."""
    if len(set(amounts)) < 2:
        return None
    return float(np.polyfit(np.log(amounts), np.log(costs), 1)[0])


TEXT = """\
Square images of a synthetic room at lambda 1e-3. The exponent e means that the cost grows as pixels^e, fitted over all
measurements of a row. It is below 1 because the constant cost of a call dominates for small images, and because large
scenes get fewer steps.

{chart}

{exponents}

{loads}
"""


def scaling_section(loads: Sequence[Load], room_side: int) -> Section:
    """Return the section. loads: two views at several image sides, and several views at `room_side`."""
    by_side = sorted((load for load in loads if load.num_views == 2), key=lambda load: load.pixels)
    by_views = sorted((load for load in loads if load.side == room_side), key=lambda load: load.pixels)
    kinds = {"two views of more pixels": by_side, f"more views of {room_side}x{room_side}": by_views}
    series = []
    for kind, own in kinds.items():
        for end in ("encode", "decode"):
            notes = ((load, f"{load.num_views} views of {_size(load)}") for load in own)
            marks = (Mark(float(load.pixels), getattr(load, f"{end}_seconds"), note) for load, note in notes)
            series.append(Series(f"{end}, {kind}", tuple(marks)))
    chart = Chart(
        "scaling", "Time and pixels", "pixels of all views", "seconds", tuple(series), has_log_x=True, has_log_y=True
    )
    text = TEXT.format(chart=picture(chart), exponents=_exponents(kinds), loads=_loads(loads))
    return Section("Growth with views and pixels", text, (chart,))


def _size(load: Load) -> str:
    return f"{load.side}x{load.side}"


def _exponents(kinds: dict[str, list[Load]]) -> str:
    rows = []
    for kind, own in kinds.items():
        pixels = [float(load.pixels) for load in own]
        names = ("encode_seconds", "decode_seconds", "peak_mib", "num_bytes")
        costs = ([getattr(load, name) for load in own] for name in names)
        rows.append(
            (kind, *(number(None if None in values else exponent(pixels, [*map(float, values)])) for values in costs))
        )
    return table(("exponent of", "encode", "decode", "peak memory", "bytes"), rows)


def _loads(loads: Sequence[Load]) -> str:
    rows = [
        (
            f"{load.num_views}",
            _size(load),
            number(load.encode_seconds, 3),
            number(load.decode_seconds, 3),
            number(load.peak_mib, 0),
            number(load.num_bytes / 1024),
        )
        for load in loads
    ]
    return table(("views", "size", "encode, s", "decode, s", "peak memory of the process, MiB", "KiB"), rows)
