"""Report section: results of the stress suite."""

from collections.abc import Sequence

from fecocodec.evaluation.report.section import Section, number, table
from fecocodec.evaluation.stress.suite import BASELINE, Verdict

TITLE = "Where methods fail"
TEXT = """\
{held} of {all} cases satisfy their rule. *lost*: loss of PSNR at target views against the reference version of the
scene, in dB. *baseline*: the same with context views as {baseline}, and our networks at the receiver. A negative loss
means that the case is easier, such as a dark image. Rules:

- *finite*: all values are finite, and the PLY file can be written;
- *warned*: also, the sender warns about the input;
- *refused*: an error explains why the input cannot be encoded;
- *same bytes*, *same picture* (within 0.05 dB), *same quality* (within 0.5 dB): compared with the reference version;
- *bounded*: the loss is at most 6 dB.
"""
HEAD = ("case", "rule", "PSNR", "lost", "baseline", "KiB", "warnings")


def stress_section(verdicts: Sequence[Verdict]) -> Section:
    """Return the section, with one row per case."""
    if not verdicts:
        return Section(TITLE, "Not measured for this report; `fecosplat stress` does.")
    by_scene: dict[str, list[tuple[str, ...]]] = {}
    for verdict in verdicts:
        scene, _, case = verdict.case.partition(": ")
        rule = f"{verdict.rule}, broken: {verdict.complaint}" if verdict.complaint else verdict.rule
        numbers = map(number, (verdict.psnr, verdict.lost, verdict.baseline_lost, verdict.kib))
        by_scene.setdefault(scene, []).append((case, rule, *numbers, f"{verdict.warnings}"))
    held = sum(verdict.is_passed for verdict in verdicts)
    text = TEXT.format(held=held, all=len(verdicts), baseline=", ".join(BASELINE))
    text += "".join(f"\n`{scene}`:\n\n{table(HEAD, rows)}\n" for scene, rows in by_scene.items())
    return Section(TITLE, text)
