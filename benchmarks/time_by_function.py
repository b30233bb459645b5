"""Where the time of an encoding goes, by function: `python benchmarks/time_by_function.py ROOT INDEX`.

Three scenes at lambda 1e-3, default effort, after warm-up: the bundled pair at 256x256, the first entry of the index
with four coded views and eight guides, and the first with eight coded views, without guides at 448x256. Prints a
Markdown table. Run it on an idle machine.
"""

import argparse
from collections import Counter
from pathlib import Path
from time import perf_counter

from torch.profiler import profile

from fecocodec import Views, read_views
from fecocodec.captures.evaluation_index import IndexEntry, read_index
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.container import quantise_lambda
from fecocodec.evaluation.novel_views import open_scenes, protocol_size, without_guides
from fecocodec.evaluation.report.section import table
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import encode_with

EXAMPLE = Path(__file__).parent.parent / "examples" / "motorcycle"
SIZE, LAMBDA_Q = (256, 256), quantise_lambda(1e-3)
OTHER = "all else: elementwise operations, copies, prior, matching"
# The first group counts of which a part is in the name of the function that PyTorch's profiler reports.
GROUPS = {
    "gradients of rendering": ("_RasterizeBackward",),
    "rendering": ("_Rasterize",),
    "gradients of convolutions": ("convolution_backward",),
    "convolutions": ("convolution",),
    "matrix products and attention": ("mm", "attention", "softmax"),
}


def seconds_by_group(codec: Codec, views: Views, guides: Views | None) -> Counter[str]:
    """Return the seconds of each group of functions in one encoding after warm-up, without profiling under ""."""
    encode_with(codec, views, LAMBDA_Q, guides=guides)
    start = perf_counter()
    encode_with(codec, views, LAMBDA_Q, guides=guides)
    seconds = Counter({"": perf_counter() - start})
    with profile() as profiled:
        encode_with(codec, views, LAMBDA_Q, guides=guides)
    for of_function in profiled.key_averages():
        group = next((name for name, parts in GROUPS.items() if any(part in of_function.key for part in parts)), OTHER)
        seconds[group] += of_function.self_cpu_time_total / 1e6
    return seconds


def entry_views(root: Path, entry: IndexEntry, size: tuple[int, int]) -> tuple[Views, Views | None]:
    """Return the coded views and the guides of an entry."""
    views, guides = without_guides(open_scenes(root, size)(entry), entry)
    return views.select(list(range(len(entry.context)))), guides


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of scenes")
    parser.add_argument("index", type=Path, help="evaluation index (JSON) whose entries have guides")
    arguments = parser.parse_args()
    codec, index = load_codec(SHIPPED / DEFAULT_MODEL, "cpu"), read_index(arguments.index)
    four = next(entry for entry in index if (len(entry.context), len(entry.guide)) == (4, 8))
    eight = next(entry for entry in index if len(entry.context) == 8)
    scenes = {
        "pair": (read_views(EXAMPLE, size=SIZE), None),
        "4 + 8 guides": entry_views(arguments.root, four, SIZE),
        "8 of 448x256": (entry_views(arguments.root, eight, protocol_size(8))[0], None),
    }
    found = {name: seconds_by_group(codec, *scene) for name, scene in scenes.items()}
    rows = [("in all, s", *(f"{seconds['']:.1f}" for seconds in found.values()))]
    for group in (*GROUPS, OTHER):
        shares = (seconds[group] / (seconds.total() - seconds[""]) for seconds in found.values())
        rows.append((group, *(f"{share:.0%}" for share in shares)))
    print(table(("function", *found), rows))


if __name__ == "__main__":
    main()
