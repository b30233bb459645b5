"""How the scenes of a batch ended: a sidecar `OUTPUT.json` of each, with what it was made from, and a table of all."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from fecocodec.atomic import write_file
from fecocodec.errors import InputError, OutputError
from fecocodec.input_file import read_json

Status = Literal["done", "failed"]
_REMEDY = "remove it, or choose another output folder"


class ForeignFileError(OutputError):
    """A file at the name of an output or of a sidecar is not by a batch; it is kept as it is."""


@dataclass(frozen=True)
class Inputs:
    """What decides the output: digest of the input, options, and ids of the weights (`model_id` and others)."""

    input_sha256: str
    options: dict[str, Any]
    weights: dict[str, str]


@dataclass(frozen=True)
class Record:
    """Content of a sidecar.

    scene, source: name and path of the scene. output: file name. num_bytes, sha256: of the output; None if there is
    none by this batch. seconds: time of the scene. finished: UTC time in ISO 8601. run: id of the run that wrote this.
    details: what the work reports, such as the number of threads. error, traceback: None unless the scene failed.
    """

    scene: str
    source: str
    status: Status
    inputs: Inputs | None
    output: str
    num_bytes: int | None
    sha256: str | None
    seconds: float
    finished: str
    run: str
    version: str
    details: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    error: str | None = None
    traceback: str | None = None


def sidecar_path(output: Path) -> Path:
    return output.with_name(f"{output.name}.json")


def write_sidecar(output: Path, record: Record) -> None:
    """Write the sidecar of an output; it replaces an earlier one. Raises OutputError if writing fails."""
    text = json.dumps(asdict(record), indent=2) + "\n"
    write_file(sidecar_path(output), text, overwrite=True)


def read_sidecar(output: Path) -> Record | None:
    """Return the record of an output, or None without a sidecar. Raises ForeignFileError if it is not a sidecar."""
    path = sidecar_path(output)
    if not path.exists():
        return None
    try:
        return _record(read_json(path, _REMEDY))
    except InputError as error:
        raise ForeignFileError(str(error)) from error
    except (KeyError, TypeError, ValueError) as error:
        raise ForeignFileError(f"{path}: this is not the sidecar of a batch; {_REMEDY}.") from error


def as_stored(inputs: Inputs) -> Inputs:
    """Return inputs as they are after writing and reading: tuples become lists."""
    return Inputs(**json.loads(json.dumps(asdict(inputs))))


def _record(value: object) -> Record:
    """Return the record of a JSON value. Raises KeyError, TypeError or ValueError for another layout."""
    if not isinstance(value, dict) or set(value) != {of.name for of in fields(Record)}:
        raise ValueError("fields")
    if value["status"] not in ("done", "failed") or not isinstance(value["seconds"], int | float):
        raise ValueError("values")
    inputs = value["inputs"]
    return Record(**{**value, "inputs": inputs and Inputs(**inputs), "warnings": tuple(value["warnings"])})


OutcomeStatus = Literal["done", "skipped", "failed"]
COLUMNS = ("scene", "status", "bytes", "seconds", "warnings", "output", "error")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One scene at the end of a run.

    status: "done" by this run; "skipped", because its output matches; or "failed". num_bytes: of the output, None if
    it failed. seconds: time that the work took, in this or the earlier run. num_warnings: the texts are in the sidecar.
    error: one sentence, None unless it failed.
    """

    scene: str
    status: OutcomeStatus
    output: str
    num_bytes: int | None
    seconds: float
    num_warnings: int
    error: str | None


def outcome_of(record: Record, *, is_new: bool) -> Outcome:
    """Return the outcome that a sidecar records. is_new: whether this run has written it."""
    status: OutcomeStatus = "skipped" if record.status == "done" and not is_new else record.status
    num_warnings = len(record.warnings)
    return Outcome(record.scene, status, record.output, record.num_bytes, record.seconds, num_warnings, record.error)


def as_tsv(outcomes: Iterable[Outcome]) -> str:
    """Return a table with one line per scene, separated by tabs, with a line of names."""
    lines = ["\t".join(COLUMNS)]
    for of in outcomes:
        size = "" if of.num_bytes is None else str(of.num_bytes)
        cells = (of.scene, of.status, size, f"{of.seconds:.3f}", str(of.num_warnings), of.output, of.error or "")
        lines.append("\t".join(" ".join(cell.split()) for cell in cells))
    return "\n".join(lines) + "\n"
