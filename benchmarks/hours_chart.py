"""Draw docs/score_by_hours.png, quality against hours of training: `python benchmarks/hours_chart.py`.

Reads docs/score_by_hours.csv: one row for each weights that shipped, with the hours behind them, and PSNR at 8 KiB of
the 31 pairs of the model card, interpolated in the logarithm of the mean file size.
"""

import csv
from pathlib import Path

from fecocodec.evaluation.report.charts import Chart, Mark, Series
from fecocodec.evaluation.report.png import write_png

DATA = Path("docs/score_by_hours.csv")
COLUMNS = {"context views": "context_db", "target views": "target_db"}


def main() -> None:
    with DATA.open(newline="") as file:
        rows = list(csv.DictReader(file))
    series = tuple(
        Series(name, tuple(Mark(float(row["hours"]), float(row[column]), row["weights"]) for row in rows))
        for name, column in COLUMNS.items()
    )
    title = f"Training, {rows[0]['weights']} to {rows[-1]['weights']}, 31 pairs at 8 KiB"
    write_png(Chart("score_by_hours", title, "hours of two cores", "PSNR, dB", series), DATA.with_suffix(".png"))


if __name__ == "__main__":
    main()
