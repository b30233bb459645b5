"""Report section: results of the stress suite."""

from collections.abc import Sequence

from fecocodec.evaluation.report.section import Section, number, table
from fecocodec.evaluation.stress.suite import BASELINE, Verdict

TITLE = "Where methods fail"
TEXT = """\
{held} of {all} cases satisfy their rule. Each case is compared with the reference version of its scene: PSNR loss at
target views, in dB, of our codec and of the baseline (context views as {baseline}, our networks at the receiver). A
negative loss means that the case is easier to reproduce, such as a dark image. Rules:

- *finite*: all values are finite, and the PLY file can be written;
- *warned*: also, the sender warns about the input;
- *refused*: an error explains why the input cannot be encoded;
- *same bytes*, *same picture* (within 0.05 dB), *same quality* (within 0.5 dB): compared with the reference version;
- *bounded*: the loss is at most 6 dB.

{rows}
"""


def stress_section(verdicts: Sequence[Verdict]) -> Section:
    """Return the section, with one row per case."""
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
