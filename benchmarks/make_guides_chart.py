"""Draw what photographs, bytes and coded views buy: `python benchmarks/make_guides_chart.py ROOT INDEX SCENE...`.

Left: guides beside four coded views. Middle: lambda, over the entries of the index with four coded views. Right: the
number of coded views, all others guiding. Left and right are whole captures, measured at photographs that neither are
coded nor guide. Writes docs/guides.png and prints all points.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import fmean

import numpy as np

from fecocodec import Views, decode, encode, read_views, render
from fecocodec.camera_files.find import read_cameras
from fecocodec.captures.evaluation_index import read_index
from fecocodec.captures.view_selection import Spread
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.codec.options import EncodingOptions
from fecocodec.codec.roles import choose_roles
from fecocodec.evaluation.report.section import Chart, Mark, Series, write_panels
from fecocodec.evaluation.run import evaluate
from fecocodec.evaluation.systems.codec import codec_system, guided_system
from fecocodec.geometry.views import joined
from fecocodec.limits import MAX_VIEWS
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import load_codec

SIZE = (256, 256)
LAMBDA, LAMBDAS = 1e-3, (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
GUIDES, CODED = (0, 2, 4, 8, 16, 24), (2, 4, 8, 16)
NUM_CODED, NUM_TARGETS = 4, 8
PSNR = "PSNR of new views, dB"


def views_of(folder: Path, num_coded: int) -> tuple[Views, list[str], Views]:
    """Return coded views, the names of photographs that can guide, and targets, as `encode` would choose them."""
    scene = read_cameras(folder)
    options = EncodingOptions(views=Spread(num_coded), num_checks=NUM_TARGETS, size=SIZE)
    roles = choose_roles(scene, folder, options, lambda order, _: order)
    coded, guides, targets = (
        [scene.photographs[index].path.name for index in indices]
        for indices in (roles.context, roles.guides, roles.checks)
    )
    return views(folder, coded), guides, views(folder, targets)


def views(folder: Path, names: list[str]) -> Views:
    """Read photographs of a scene, however many."""
    parts = (names[first : first + MAX_VIEWS] for first in range(0, len(names), MAX_VIEWS))
    return joined([read_views(folder, views=tuple(part), size=SIZE) for part in parts])


def mark(x: float, data: bytes, targets: Views) -> Mark:
    """Return the PSNR of targets, rendered from a decoded file, at `x`."""
    rendered = render(decode(data).gaussians, targets.cameras, SIZE).color.clamp(0, 1)
    quality = float(psnr(rendered, targets.images).mean())
    print(f"{x:g}\t{len(data) / 1024:.2f} KiB\t{quality:.2f} dB", flush=True)
    return Mark(x, quality, f"{len(data) / 1024:.1f} KiB")


def by_guides(folder: Path) -> Iterator[Mark]:
    """Yield one mark for each number of guides, which are spread over all that can guide."""
    coded, names, targets = views_of(folder, NUM_CODED)
    for count in sorted({min(count, len(names)) for count in GUIDES}):
        chosen = [names[index] for index in np.linspace(0, len(names) - 1, count).round().astype(int)]
        guides = views(folder, chosen) if chosen else None
        yield mark(count, encode(coded, lmbda=LAMBDA, guides=guides), targets)


def by_coded(folder: Path) -> Iterator[Mark]:
    """Yield one mark for each number of coded views, all measured at the targets of the largest number."""
    *_, targets = views_of(folder, CODED[-1])
    for count in CODED:
        coded, names, _ = views_of(folder, count)
        guides = views(folder, names) if names else None
        yield mark(count, encode(coded, lmbda=LAMBDA, guides=guides), targets)


def by_rate(root: Path, index: Path) -> Iterator[Series]:
    """Yield the means over the entries of the index, without and with guides."""
    codec = load_codec(SHIPPED / DEFAULT_MODEL, "cpu")
    entries = tuple(entry for entry in read_index(index) if len(entry.context) == NUM_CODED)
    for name, system_at in (("without guides", codec_system), ("with guides", guided_system)):
        marks = []
        for lmbda in LAMBDAS:
            scores = list(evaluate(system_at(codec, lmbda), root, entries, SIZE))
            kib, quality = (fmean(s.num_bytes for s in scores) / 1024, fmean(s.psnr for s in scores))
            print(f"{name}\tlambda {lmbda:g}\t{kib:.2f} KiB\t{quality:.2f} dB", flush=True)
            marks.append(Mark(kib, quality, f"lambda {lmbda:g}"))
        yield Series(name, tuple(marks))


def series(folders: list[Path], marks_of: Callable[[Path], Iterator[Mark]]) -> tuple[Series, ...]:
    """Return a line for each scene."""
    return tuple(Series(folder.name, tuple(marks_of(folder))) for folder in folders)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of scenes")
    parser.add_argument("index", type=Path, help="evaluation index (JSON) whose entries have guides")
    parser.add_argument("scenes", nargs="+", help="names of whole captures")
    arguments = parser.parse_args()
    folders = [arguments.root / name for name in arguments.scenes]
    charts = [
        Chart(
            "guides", "A photograph that is not coded", "guides beside 4 coded views", PSNR, series(folders, by_guides)
        ),
        Chart("rate", "A KiB", "KiB, mean of entries", PSNR, tuple(by_rate(arguments.root, arguments.index)), True),
        Chart("coded", "A coded view", "coded views, the others guide", PSNR, series(folders, by_coded)),
    ]
    write_panels(charts, Path("docs/guides.png"))


if __name__ == "__main__":
    main()
