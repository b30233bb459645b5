"""What every refusal of the command line looks like."""

import re
from pathlib import Path

SENTENCE = re.compile(r"fecosplat: [^\n]+; [^\n]+\.\n")  # what is wrong with what; a remedy
NEXT_SENTENCE = re.compile(r"[.!?] [A-Z]")


def assert_refused(result, output: Path, sentence: str) -> None:
    """`sentence` is the whole text, or its beginning where it ends in three dots."""
    assert (result.code, result.out) == (1, "")
    assert SENTENCE.fullmatch(result.err) and not NEXT_SENTENCE.search(result.err)
    if sentence.endswith("..."):
        assert result.err.startswith(f"fecosplat: {sentence.removesuffix('...')}")
    else:
        assert result.err == f"fecosplat: {sentence}\n"
    assert list(output.iterdir()) == []
