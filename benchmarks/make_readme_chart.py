"""Draw the README's chart: `python benchmarks/make_readme_chart.py ROOT INDEX [--views 8]`.

Measures the codec, AVIF photographs and the best plane on 12 pairs, or reuses what `make report` has measured in
out/report, prints PSNR at equal bytes and writes docs/rate_distortion.png. With --views, the entries with so many
context views take the place of the pairs, with AVIF alone beside three lambdas, and the chart is
docs/report/VIEWS_views.png.
"""

import argparse
from pathlib import Path

from fecocodec.atomic import make_folder
from fecocodec.captures.evaluation_index import read_index
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.evaluation.evaluation import RECORDS, choose_entries, weights_label
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.evaluation.records import RecordFile
from fecocodec.evaluation.report.rate_section import curves_of, equal_bytes_table
from fecocodec.evaluation.report.section import Chart, ReportPlan, write_png
from fecocodec.evaluation.run import measure_all
from fecocodec.evaluation.summary import as_tsv, averages, compare
from fecocodec.evaluation.systems.groups import systems_of
from fecocodec.sender.codec import load_codec

BASELINES = ("AVIF", "best plane")
OPTIMISED = "AVIF, optimised at the receiver"  # in the table alone


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of scenes")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("--views", type=int, default=2, help="context views of an entry  [default: 2]")
    arguments = parser.parse_args()
    is_of_pairs = arguments.views == 2
    plan = ReportPlan(arguments.root, arguments.index, SHIPPED / DEFAULT_MODEL, Path("out/report"), Path("docs"))
    codec = load_codec(plan.model, "cpu")
    wanted = (*BASELINES, OPTIMISED) if is_of_pairs else BASELINES[:1]
    baselines = [system for system in systems_of(["images", "trivial"], codec, ()) if system.name in wanted]
    systems = [*systems_of(["codec"], codec, plan.lambdas if is_of_pairs else plan.few_lambdas), *baselines]
    entries = choose_entries(read_index(plan.index), arguments.views, plan.entries, plan.index)
    make_folder(plan.work)
    label = weights_label(plan.model, plan.size)
    read = open_scenes(plan.root, plan.size)
    found = tuple(measure_all(read, entries, systems, RecordFile(plan.work / RECORDS), label))
    rows = averages(found)
    kind = "pairs" if is_of_pairs else f"entries of {arguments.views} views"
    title = f"Rate and quality, weights {plan.model.name}, {len(entries)} {kind}"
    chart = Chart(
        "rate_distortion",
        title,
        "KiB a scene",
        "PSNR of target views, dB",
        curves_of([row for row in rows if row.system != OPTIMISED]),
        True,
    )
    write_png(chart, plan.output / ("rate_distortion.png" if is_of_pairs else f"report/{arguments.views}_views.png"))
    print(equal_bytes_table(found, [row.system for row in rows]))
    print(as_tsv(compare(rows)))
    print(as_tsv(rows))


if __name__ == "__main__":
    main()
