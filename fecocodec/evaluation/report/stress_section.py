"""The stability suite as a table."""

from collections.abc import Sequence

from fecocodec.evaluation.report.section import Section, number, table
from fecocodec.evaluation.stress.suite import BASELINE, Verdict

TITLE = "Where methods fail"
TEXT = """\
{held} of {all} cases keep their rule. Each is compared with the easy version of its scene: dB of target views lost by
us and by the baseline (context views as {baseline}, our networks at the receiver). A negative loss: the case is easier
to reproduce, as a dark image is. Rules: *finite*, every value is, and the PLY can be written; *warned*, the sender also
says that quality cannot be had; *refused*, an error that says why; *same bytes*, *same picture* (0.05 dB), *same
quality* (0.5 dB) as the easy version; *bounded*, at most 6 dB lost.

{rows}
"""


def stress_section(verdicts: Sequence[Verdict]) -> Section:
    """One row a case; says so where none was measured."""
    if not verdicts:
        return Section(TITLE, "Not measured for this report; `fecosplat stress` does.")
    rows = [
        (
            verdict.case,
            verdict.rule,
            number(verdict.psnr),
            number(verdict.lost),
            number(verdict.baseline_lost),
            number(verdict.kib),
            f"{verdict.warnings}",
            verdict.complaint or "holds",
        )
        for verdict in verdicts
    ]
    head = ("case", "rule", "PSNR", "lost", "baseline lost", "KiB", "warnings", "")
    held = sum(verdict.is_passed for verdict in verdicts)
    text = TEXT.format(held=held, all=len(verdicts), baseline=", ".join(BASELINE), rows=table(head, rows))
    return Section(TITLE, text)
