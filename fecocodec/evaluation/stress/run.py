"""Run the whole stress suite on some scenes of an evaluation index."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from fecocodec.captures.evaluation_index import read_index
from fecocodec.evaluation.entries import open_scenes
from fecocodec.evaluation.evaluation import choose_entries
from fecocodec.evaluation.stress.cases import Trial, cases_of, room_cases
from fecocodec.evaluation.stress.suite import StressSuite, Verdict
from fecocodec.sender.codec import Codec


def read_pairs(root: Path, index: Path, most: int) -> dict[str, Trial]:
    """Read at most `most` two-view entries, evenly spaced over the index, by name.

    Raises InputError if there is no such entry, or if a scene cannot be read.
    """
    read = open_scenes(root)
    entries = choose_entries(read_index(index), 2, most, index)
    return {entry.name: Trial(read(entry), 2) for entry in entries}


def run_suite(
    codec: Codec, pairs: Mapping[str, Trial], lmbda: float, known: Mapping[str, Verdict] | None = None
) -> Iterator[tuple[Verdict, float]]:
    """Yield each verdict with the completed fraction: cases of every pair, of the room, and repeated coding of pairs.

    known: verdicts of an earlier run by case, which are reused.
    """
    suite, known = StressSuite(codec, lmbda), known or {}
    cases = [case for name, pair in pairs.items() for case in cases_of(pair, name)] + list(room_cases())
    total = len(cases) + len(pairs)
    for number, case in enumerate(cases, start=1):
        yield known.get(case.name) or suite.judge(case), number / total
    for number, (name, pair) in enumerate(pairs.items(), start=len(cases) + 1):
        yield known.get(suite.name_of_generations(name)) or suite.judge_generations(name, pair), number / total
