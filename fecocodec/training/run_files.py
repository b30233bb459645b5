"""Files of a training run: checkpoints, with everything needed to resume exactly, and the log."""

import csv
import os
from pathlib import Path
from typing import Any

import torch

from fecocodec.atomic import write_atomically
from fecocodec.errors import ModelError, OutputError


def save_checkpoint(path: Path, contents: dict[str, Any]) -> None:
    """Write to a temporary name and rename, so that an interruption leaves the old or the new file, never a part.

    Raises OutputError if writing fails (disk full, no permission); the old file is kept.
    """
    partial = path.with_suffix(".partial")
    try:
        torch.save(contents, partial)
        os.replace(partial, path)
    except (OSError, RuntimeError) as error:  # torch's writer raises RuntimeError for a full disk
        partial.unlink(missing_ok=True)
        reason = str(error).splitlines()[0]
        raise OutputError(
            f"{path}: the checkpoint cannot be written ({reason}); make room or train in another folder."
        ) from error


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a file of `save_checkpoint`. Raises ModelError for anything else."""
    if path.exists() and not path.is_file():
        raise ModelError(f"{path}: not a training checkpoint (no regular file); delete it or name another.")
    try:
        contents = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can fail in many ways
        kind = type(error).__name__
        raise ModelError(f"{path}: not a training checkpoint ({kind}); delete it or name another.") from error
    if not isinstance(contents, dict):
        raise ModelError(f"{path}: not a training checkpoint (a {type(contents).__name__}); delete it or name another.")
    return contents


LOG_COLUMNS = (
    "step", "minutes", "loss", "mse1", "mse2", "mse_context1", "mse_context2", "bpp1", "bpp2",
    "matching", "disparity1", "disparity2", "gradient", "skipped",
    "mse3", "mse_context3", "bpp3", "bad_scenes", "val_psnr", "val_st_lpips", "val_bpp", "perceptual", "analysis",
)  # fmt: skip


def append_row(path: Path, row: dict[str, float]) -> None:
    """Append a row to a CSV file of `LOG_COLUMNS`; missing columns are empty. Raises OutputError if writing fails."""
    cells = (f"{row[name]:.6g}" if name in row else "" for name in LOG_COLUMNS)
    rows = [cells] if path.exists() else [LOG_COLUMNS, cells]
    _append(path, "".join(f"{','.join(row)}\r\n" for row in rows))


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
    _append(path, "".join(f"{line}\n" for line in lines))


def _append(path: Path, text: str) -> None:
    try:
        with path.open("a", encoding="utf-8", newline="") as file:
            file.write(text)
    except OSError as error:
        raise OutputError(f"{path}: the log cannot be written ({error.strerror}); check free space.") from error
