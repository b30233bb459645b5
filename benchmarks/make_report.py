"""Generate the report docs/report.md and its charts: `make report ROOT=scenes INDEX=index.json`.

An interrupted run resumes where it stopped; measurements of other weights are not reused. Run it on an idle machine,
because other load changes the timings.
"""

import argparse
from pathlib import Path
from time import perf_counter

from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.errors import FecoError
from fecocodec.evaluation.report.make import make_report
from fecocodec.evaluation.report.section import ReportPlan, quick


def main() -> None:
    """Print the start of each study. The exit code is 1 if a measurement failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, help="folder of scenes or chunks")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("--model", type=Path, default=SHIPPED / DEFAULT_MODEL, help="folder of the weights")
    parser.add_argument(
        "--work", type=Path, default=Path("out/report"), help="folder of measurements, reused by the next run"
    )
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder of report.md and report/")
    parser.add_argument(
        "--entries", type=int, default=ReportPlan.entries, help="number of two-view entries for rate and quality"
    )
    parser.add_argument("--quick", action="store_true", help="a few small images, to test the script")
    arguments = parser.parse_args()
    plan = ReportPlan(
        arguments.root, arguments.index, arguments.model, arguments.work, arguments.output, arguments.entries
    )
    begin = perf_counter()
    failures = make_report(
        quick(plan) if arguments.quick else plan,
        lambda study: print(f"{perf_counter() - begin:7.1f} s  {study}", flush=True),
    )
    print(f"{perf_counter() - begin:7.1f} s  done: {plan.output / 'report.md'}")
    if failures:
        raise SystemExit("\n".join(failures))


if __name__ == "__main__":
    try:
        main()
    except FecoError as error:
        raise SystemExit(str(error)) from error
