"""Measurements as lines of JSON, each appended at once, so that an interrupted run can be resumed."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from fecocodec.errors import InputError, OutputError


@dataclass(frozen=True)
class Measurement:
    """One entry through one system. Metrics are means over views: of the target views, `context_psnr` of the context.

    bits_per_pixel: of a context view. peak_mib: resident memory of the process while it was measured, None where the
    system does not report it. error: why there are no other values, else empty.
    """

    entry: str
    system: str
    setting: str
    model: str
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
    lpips: float | None = None
    context_psnr: float = 0.0
    encode_seconds: float = 0.0
    decode_seconds: float = 0.0
    peak_mib: float | None = None
    error: str = ""

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.entry, self.system, self.setting, self.model


class RecordFile:
    """Measurements in a file of JSON lines; those that are there are known, failures are not and are tried again."""

    def __init__(self, path: Path) -> None:
        """Raises InputError where the file is there but holds something else."""
        self.path = path
        self.measurements: dict[tuple[str, str, str, str], Measurement] = {}
        for measurement in _read(path) if path.exists() else ():
            self.measurements[measurement.key] = measurement

    def is_known(self, key: tuple[str, str, str, str]) -> bool:
        """Whether it was measured without an error."""
        known = self.measurements.get(key)
        return known is not None and not known.error

    def add(self, measurement: Measurement) -> None:
        """Remember it, and append it to the file; raises OutputError where that fails."""
        self.measurements[measurement.key] = measurement
        try:
            with self.path.open("a") as file:
                file.write(json.dumps(asdict(measurement)) + "\n")
        except OSError as error:
            raise OutputError(
                f"{self.path}: writing failed ({error.strerror}); check free space and permissions."
            ) from error

    def select(self, wanted: Callable[[Measurement], bool]) -> tuple[Measurement, ...]:
        """Those without an error for which `wanted` holds, in the order they were measured."""
        return tuple(found for found in self.measurements.values() if not found.error and wanted(found))


def _read(path: Path) -> tuple[Measurement, ...]:
    """The measurements of a file; a last line that an interruption has cut is removed from it."""
    try:
        data = path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            path.write_bytes(whole)
        return tuple(Measurement(**json.loads(line)) for line in whole.decode().splitlines())
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not measurements of this version ({error}); give another output folder.") from error
