"""Measurements in a JSON Lines file. Each is appended immediately, so that an interrupted run can be resumed."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fecocodec.errors import InputError, OutputError

Key = tuple[str, str, str, str, str]


@dataclass(frozen=True)
class Measurement:
    """Result of one system on one entry. Metrics are means over the target views; `context_psnr` over context views.

    setting: operating point, see `System`. model: label of the weights. inputs: `EntryReader.digest`; empty in records
    of earlier versions, which are measured again. bits_per_pixel: bits of the whole file per pixel of the context
    views. peak_mib: peak resident memory of the process during the measurement, None if the system does not report it.
    error: message if the measurement failed, in which case the other values are not set. num_guides: see
    `Reconstruction`. warnings: sentences about the context views, and of the sender.
    """

    entry: str
    system: str
    setting: str
    model: str
    inputs: str = ""
    num_context: int = 0
    height: int = 0
    width: int = 0
    num_bytes: int = 0
    bits_per_pixel: float = 0.0
    num_gaussians: int = 0
    psnr: float = 0.0
    ssim: float = 0.0
    ms_ssim: float | None = None
    flip: float | None = None
    st_lpips: float | None = None
    lpips: float | None = None
    lpips_alex: float | None = None
    context_psnr: float = 0.0
    encode_seconds: float = 0.0
    decode_seconds: float = 0.0
    peak_mib: float | None = None
    error: str = ""
    num_guides: int = 0
    warnings: str = ""

    @property
    def key(self) -> Key:
        """Identity of the measurement: (entry, system, setting, model, inputs)."""
        return self.entry, self.system, self.setting, self.model, self.inputs


class RecordFile:
    """Measurements backed by a JSON Lines file. Those in the file are not repeated, except failed ones."""

    def __init__(self, path: Path, others: Sequence[Path] = ()) -> None:
        """Read the file, if it exists, after `others`, which are never written. Raises InputError for other content."""
        self.path = path
        self.measurements: dict[Key, Measurement] = {}
        for known in (*others, path):
            for measurement in _read(known) if known.exists() else ():
                self.measurements[measurement.key] = measurement

    def is_known(self, key: Key) -> bool:
        """Return whether there is a measurement with this key and without an error."""
        known = self.measurements.get(key)
        return known is not None and not known.error

    def add(self, measurement: Measurement) -> None:
        """Store a measurement and append it to the file. Raises OutputError if writing fails."""
        self.measurements[measurement.key] = measurement
        append_row(self.path, asdict(measurement))

    def select(self, wanted: Callable[[Measurement], bool]) -> tuple[Measurement, ...]:
        """Return the measurements without an error for which `wanted` is true, in the order of measurement."""
        return tuple(m for m in self.measurements.values() if not m.error and wanted(m))


def _read(path: Path) -> tuple[Measurement, ...]:
    try:
        return tuple(Measurement(**row) for row in read_rows(path))
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not measurements of this version ({error}); give another output folder.") from error


def read_rows(path: Path) -> list[Any]:
    """Read a JSON Lines file. An incomplete last line, left by an interruption, is removed from the file."""
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        path.write_bytes(whole)
    return [json.loads(line) for line in whole.decode().splitlines()]


def append_row(path: Path, row: dict[str, Any]) -> None:
    """Append a row to a JSON Lines file. Raises OutputError if writing fails."""
    try:
        with path.open("a") as file:
            file.write(json.dumps(row) + "\n")
    except OSError as error:
        raise OutputError(f"{path}: writing failed ({error.strerror}); check free space and permissions.") from error
