"""Report section: scaling of time, memory and file size with the number of pixels and views."""

from collections.abc import Sequence

from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.section import Section, number, picture, table
from fecocodec.evaluation.scaling import Load, exponent

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
        series.append(Series(f"encode, {kind}", tuple(Mark(float(o.pixels), o.encode_seconds, _note(o)) for o in own)))
        series.append(Series(f"decode, {kind}", tuple(Mark(float(o.pixels), o.decode_seconds, _note(o)) for o in own)))
    chart = Chart(
        "scaling", "Time and pixels", "pixels of all views", "seconds", tuple(series), has_log_x=True, has_log_y=True
    )
    text = TEXT.format(chart=picture(chart), exponents=_exponents(kinds), loads=_loads(loads))
    return Section("Growth with views and pixels", text, (chart,))


def _note(load: Load) -> str:
    return f"{load.num_views} views of {load.side}x{load.side}"


def _exponents(kinds: dict[str, list[Load]]) -> str:
    rows = []
    for kind, own in kinds.items():
        pixels = [float(load.pixels) for load in own]
        peaks = [load.peak_mib for load in own if load.peak_mib is not None]
        rows.append(
            (
                kind,
                number(exponent(pixels, [load.encode_seconds for load in own])),
                number(exponent(pixels, [load.decode_seconds for load in own])),
                number(exponent(pixels, peaks) if len(peaks) == len(own) else None),
                number(exponent(pixels, [float(load.num_bytes) for load in own])),
            )
        )
    return table(("exponent of", "encode", "decode", "peak memory", "bytes"), rows)


def _loads(loads: Sequence[Load]) -> str:
    rows = [
        (
            f"{load.num_views}",
            f"{load.side}x{load.side}",
            number(load.encode_seconds, 3),
            number(load.decode_seconds, 3),
            number(load.peak_mib, 0),
            number(load.num_bytes / 1024),
        )
        for load in loads
    ]
    return table(("views", "size", "encode, s", "decode, s", "peak memory of the process, MiB", "KiB"), rows)
