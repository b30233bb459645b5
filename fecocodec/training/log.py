"""Log of a training run, a CSV file."""

import csv
from pathlib import Path

from fecocodec.atomic import write_atomically
from fecocodec.errors import OutputError

LOG_COLUMNS = (
    "step", "minutes", "loss", "mse1", "mse2", "mse_context1", "mse_context2", "bpp1", "bpp2",
    "matching", "disparity1", "disparity2", "gradient", "skipped",
    "mse3", "mse_context3", "bpp3", "bad_scenes", "val_psnr", "val_st_lpips", "val_bpp", "perceptual", "analysis",
)  # fmt: skip


def append_row(path: Path, row: dict[str, float]) -> None:
    """Append a row to a CSV file with the header `LOG_COLUMNS`; missing columns stay empty.

    Raises OutputError if the file cannot be written.
    """
    is_new = not path.exists()
    try:
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, LOG_COLUMNS, extrasaction="ignore")
            if is_new:
                writer.writeheader()
            writer.writerow({name: f"{value:.6g}" for name, value in row.items()})
    except OSError as error:
        raise OutputError(f"{path}: the log cannot be written ({error.strerror}); check free space.") from error


def remove_rows_after(path: Path, step: int) -> None:
    """Remove rows of steps after `step`, the last checkpoint's, because a resumed run takes those steps again."""
    if not path.exists():
        return
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    kept = [row for index, row in enumerate(rows) if index == 0 or (row and float(row[0]) <= step)]
    with write_atomically(path, overwrite=True) as temporary, temporary.open("w", newline="") as file:
        csv.writer(file).writerows(kept)


def mean_of_rows(rows: list[dict[str, float]]) -> dict[str, float]:
    """Return the mean of every column over the rows that have it."""
    columns = {name: [row[name] for row in rows if name in row] for row in rows for name in row}
    return {name: sum(values) / len(values) for name, values in columns.items()}


def append_lines(path: Path, lines: tuple[str, ...]) -> None:
    """Append lines to a text file. Raises OutputError if the file cannot be written."""
    try:
        with path.open("a", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in lines)
    except OSError as error:
        raise OutputError(f"{path}: the log cannot be written ({error.strerror}); check free space.") from error
