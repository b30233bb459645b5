"""Report section: file size and number of Gaussians of synthetic rooms and photographs against their complexity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.records import Measurement
from fecocodec.evaluation.report.section import Chart, Mark, Section, Series, picture
from fecocodec.evaluation.stress.box_room import Room, blank, photograph, sideways, waves
from fecocodec.evaluation.summary import OURS
from fecocodec.evaluation.systems.image_compression import encode_image
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with

LAMBDA = 1e-3


@dataclass(frozen=True)
class Need:
    """Size of one coded room. num_waves: number of superimposed patterns on its walls, 0 for one grey per wall.

    photograph_kib: size of the context views as JPEG XL at distance 1, the measure of complexity. kib: size of the
    coded file. gaussians_per_pixel: number of Gaussians per pixel of the context views.
    """

    num_waves: int
    photograph_kib: float
    kib: float
    gaussians_per_pixel: float


def measure_need(codec: Codec, num_waves: int, side: int) -> Need:
    """Encode and decode two square views of the room with `num_waves` patterns. side: image side in pixels."""
    paint = partial(waves, count=num_waves) if num_waves else blank
    views = photograph(Room(paint), sideways(), (side, side)).select([0, 1])
    data = encode_with(codec, views, quantise_lambda(LAMBDA))
    density = decode_with(codec.receiver, data).gaussians.count / (2 * side * side)
    return Need(num_waves, photograph_kib(views), len(data) / 1024, density)


def photograph_kib(views: Views) -> float:
    """Return the size of the views in KiB as JPEG XL at distance 1. Raises InputError if imagecodecs is missing."""
    files = [encode_image(image, "JPEG XL", 1.0) for image in views.images]
    return sum(map(len, files)) / 1024


TEXT = """\
Complexity is the size of the context views as JPEG XL at distance 1. Files at lambda 1e-3, of photographs and of
synthetic rooms whose walls have no pattern or the sum of up to {waves} patterns.

{bytes_chart}

{gaussians_chart}
"""


def complexity_section(
    photographs: Sequence[Measurement], complexity: Mapping[str, float], needs: Sequence[Need]
) -> Section:
    """Return the section.

    photographs: measurements of pairs at one lambda. complexity: size of the context views in KiB, by entry of
    `photographs`. needs: measurements of synthetic rooms.
    """
    at_lambda = [m for m in photographs if m.system == OURS and m.setting == f"lambda {LAMBDA:g}" and not m.error]
    shown = [(m, complexity[m.entry]) for m in at_lambda]
    densities = ((x, m.num_gaussians / (m.num_context * m.height * m.width), m.entry) for m, x in shown)
    patterns = [(need, f"{need.num_waves} patterns") for need in needs]
    x_label = "KiB of the photographs as JPEG XL"
    sizes = (
        Series("rooms", tuple(Mark(need.photograph_kib, need.kib, note) for need, note in patterns)),
        Series("photographs", tuple(Mark(x, m.num_bytes / 1024, m.entry) for m, x in shown), is_line=False),
    )
    kib = Chart("complexity_bytes", "Bytes and complexity", x_label, "KiB of the file", sizes)
    counts = (
        Series("photographs", tuple(Mark(*point) for point in densities), is_line=False),
        Series("rooms", tuple(Mark(need.photograph_kib, need.gaussians_per_pixel, note) for need, note in patterns)),
    )
    gaussians = Chart("complexity_gaussians", "Gaussians and complexity", x_label, "Gaussians a context pixel", counts)
    text = TEXT.format(
        waves=max((n.num_waves for n in needs), default=0),
        bytes_chart=picture(kib),
        gaussians_chart=picture(gaussians),
    )
    return Section("Bytes, Gaussians and complexity", text, (kib, gaussians))
