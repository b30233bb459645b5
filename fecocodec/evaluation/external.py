"""Results of other systems, measured elsewhere, from a CSV file: for curves and tables beside our own."""

import csv
import math
from dataclasses import dataclass, fields
from pathlib import Path

from fecocodec.errors import InputError
from fecocodec.input_file import require_regular_file


@dataclass(frozen=True)
class ExternalRow:
    """One operating point of another system. Only the name is required; None: not measured.

    kib: size of a scene. psnr in dB. sender_params, receiver_params: in millions. encode_seconds, decode_seconds: per
    scene. peak_gib: peak memory in GiB.
    """

    system: str
    setting: str = ""
    kib: float | None = None
    psnr: float | None = None
    ssim: float | None = None
    st_lpips: float | None = None
    lpips: float | None = None
    sender_params: float | None = None
    receiver_params: float | None = None
    encode_seconds: float | None = None
    decode_seconds: float | None = None
    peak_gib: float | None = None


COLUMNS = tuple(field.name for field in fields(ExternalRow))
_TEXTS = ("system", "setting")


def read_external(path: Path) -> tuple[ExternalRow, ...]:
    """Read a CSV file whose header is `system` and any other of COLUMNS; empty cells are not measured.

    Raises InputError for another column, a row without a name, and a cell that is no finite number.
    """
    try:
        require_regular_file(path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, strict=True)
            unknown = [name for name in reader.fieldnames or () if name not in COLUMNS]
            if unknown or "system" not in (reader.fieldnames or ()):
                raise InputError(f"{path}: its columns must be among {', '.join(COLUMNS)}, with system; name them so.")
            return tuple(_row(path, number, row) for number, row in enumerate(reader, start=2))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV file that can be read ({error}); check the path and the file.") from error


def _row(path: Path, line: int, cells: dict[str | None, str | None]) -> ExternalRow:
    if None in cells or None in cells.values() or not cells["system"]:
        raise InputError(f"{path}, line {line}: has no system, or not one cell a column; correct the line.")
    texts = {name: cells[name] or "" for name in _TEXTS if name in cells}
    numbers = {name: _number(path, line, name, cells.get(name) or "") for name in COLUMNS if name not in _TEXTS}
    return ExternalRow(**texts, **numbers)  # type: ignore[arg-type]


def _number(path: Path, line: int, name: str, text: str) -> float | None:
    if not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}, line {line}: {name} is {text!r}, not a number; leave it empty if it is not known.")
    return value
