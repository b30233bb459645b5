"""Report section: results of the stress suite."""

from collections.abc import Sequence

from fecocodec.evaluation.report.section import Section, number, table
from fecocodec.evaluation.stress.suite import GENERATIONS, Verdict
from fecocodec.evaluation.systems.image_compression import JPEG_XL

TITLE = "Where methods fail"
TEXT = """\
{held} of {all} cases satisfy their rule. *lost*: loss of PSNR at target views against the reference version of the
scene, in dB; negative where the case is easier. *ahead*: PSNR above that of context views as {baseline} of about the
same bytes, with our networks at the receiver. Values of several scenes are separated by slashes. Rules:

- *≤N*: at most N dB are lost; for {generations} generations, against the first;
- *warned*: the warning that belongs to the case comes; *warned or ≤N*: if more is lost;
- *refused*: an error explains why the input cannot be encoded;
- *same bytes*: the payloads equal those of the reference;
- all values are finite, and *ahead* is -0.5 or more.
"""
HEAD = ("case", "rule", "PSNR", "lost", "ahead", "warnings")
ROOM = "room"


def stress_section(verdicts: Sequence[Verdict]) -> Section:
    """Return the section, with one row per case of the photographs and of the room."""
    if not verdicts:
        return Section(TITLE, "Not measured for this report; `fecosplat stress` does.")
    held = sum(verdict.is_passed for verdict in verdicts)
    text = TEXT.format(held=held, all=len(verdicts), baseline=JPEG_XL, generations=GENERATIONS)
    of_room = [verdict for verdict in verdicts if _scene(verdict) == ROOM]
    for group in ([verdict for verdict in verdicts if _scene(verdict) != ROOM], of_room):
        cases: dict[str, list[Verdict]] = {}
        for verdict in group:
            cases.setdefault(verdict.case.partition(": ")[2], []).append(verdict)
        scenes = ", ".join(f"`{scene}`" for scene in dict.fromkeys(map(_scene, group)))
        if cases:
            text += f"\n{scenes}:\n\n{table(HEAD, [_row(case, found) for case, found in cases.items()])}\n"
    return Section(TITLE, text)


def _scene(verdict: Verdict) -> str:
    return verdict.case.partition(": ")[0]


def _row(case: str, found: Sequence[Verdict]) -> tuple[str, ...]:
    """Return the row of one case. found: its verdicts, one per scene."""
    broken = [f"**broken** by {_scene(verdict)}" for verdict in found if verdict.complaint]
    values = [(v.psnr, v.lost, v.ahead) for v in found]
    numbers = (
        "-" if set(of_scenes) == {None} else "/".join(map(number, of_scenes)) for of_scenes in zip(*values, strict=True)
    )
    return (case, ", ".join([found[0].rule, *broken]), *numbers, "/".join(f"{v.warnings}" for v in found))
