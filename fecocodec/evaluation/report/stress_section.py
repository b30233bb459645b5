"""Report section: results of the stress suite."""

from collections.abc import Sequence

from fecocodec.evaluation.report.section import Section, number, table
from fecocodec.evaluation.stress.suite import BASELINE, GENERATIONS, Verdict

TITLE = "Where methods fail"
TEXT = """\
{held} of {all} cases satisfy their rule. *lost*: loss of PSNR at target views against the reference version of the
scene, in dB; it is negative where the case is easier, such as a dark image. *ahead*: PSNR above that of context views
as {baseline} of about the same bytes (*{baseline} KiB*), with our networks at the receiver. All values must be finite,
and the PLY file can be written. Further rules:

- *at most N dB*: the loss; for {generations} generations, against the first;
- *warned*: the sender's warnings have the one that belongs to the case; *or at most N dB*: if more is lost;
- *refused*: an error explains why the input cannot be encoded;
- *same bytes*: the payloads equal those of the reference;
- *ahead* is -0.5 dB or more, except where [limits.md](limits.md#quality) says more.
"""
HEAD = ("case", "rule", "PSNR", "lost", "KiB", "ahead", f"{BASELINE} KiB", "warnings")


def stress_section(verdicts: Sequence[Verdict]) -> Section:
    """Return the section, with one row per case."""
    if not verdicts:
        return Section(TITLE, "Not measured for this report; `fecosplat stress` does.")
    by_scene: dict[str, list[tuple[str, ...]]] = {}
    for verdict in verdicts:
        scene, _, case = verdict.case.partition(": ")
        rule = f"{verdict.rule}, broken: {verdict.complaint}" if verdict.complaint else verdict.rule
        numbers = map(number, (verdict.psnr, verdict.lost, verdict.kib, verdict.ahead, verdict.baseline_kib))
        by_scene.setdefault(scene, []).append((case, rule, *numbers, f"{verdict.warnings}"))
    held = sum(verdict.is_passed for verdict in verdicts)
    text = TEXT.format(held=held, all=len(verdicts), baseline=BASELINE, generations=GENERATIONS)
    text += "".join(f"\n`{scene}`:\n\n{table(HEAD, rows)}\n" for scene, rows in by_scene.items())
    return Section(TITLE, text)
