"""How one scene of a batch ended, and the table of all of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from fecocodec.batch.sidecar import Record

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
    is_made = record.status == "done"
    num_bytes = record.num_bytes if is_made else None
    return Outcome(record.scene, status, record.output, num_bytes, record.seconds, len(record.warnings), record.error)


def as_tsv(outcomes: Iterable[Outcome]) -> str:
    """Return a table with one line per scene, separated by tabs, with a line of names."""
    lines = ["\t".join(COLUMNS)]
    for of in outcomes:
        size = "" if of.num_bytes is None else str(of.num_bytes)
        cells = (of.scene, of.status, size, f"{of.seconds:.3f}", str(of.num_warnings), of.output, of.error or "")
        lines.append("\t".join(" ".join(cell.split()) for cell in cells))
    return "\n".join(lines) + "\n"
