"""Documents are plain: short sentences, few measured numbers in a paragraph, few words in all. `make lint` runs it.

The hook that `make` installs refuses commits whose subject is too long.
"""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MAX_SENTENCE = 30  # words
MAX_MEASURED = 3  # numbers with a unit in a paragraph; more are a table
MAX_WORDS = 25_000  # of all documents but the specification and model cards
MAX_WORDS_OF = {"docs/what_we_learned.md": 1_500}
UNTRACKED = {"node_modules", "out", "runs", "build", "data"}
QUANTITY = re.compile(r"\d ?(?:%|dB|[KMG]iB|ms|s)(?!\w)")


def documents() -> list[str]:
    paths = (path.relative_to(ROOT) for path in ROOT.rglob("*.md"))
    return sorted(path.as_posix() for path in paths if not any(p in UNTRACKED or p[0] == "." for p in path.parts))


DOCUMENTS = documents()


def read(document: str) -> str:
    return (ROOT / document).read_text()


def prose_and_cells(text: str) -> tuple[list[str], list[str]]:
    """Return the paragraphs and list items of a Markdown text, and the cells of its tables. Code and links become X."""
    prose, cells = [""], list[str]()
    for raw in re.sub(r"^```.*?^```", "", text, flags=re.M | re.S).splitlines():
        line = re.sub(r"!?\[[^]]*\]\([^)]*\)", "X", re.sub(r"`[^`]*`", "X", raw)).strip().lstrip("> ")
        item = re.match(r"(?:[-*]|\d+\.) (.*)", line)
        if line.startswith("|") or " | " in line:
            cells += [cell.strip() for cell in line.split("|")]
        elif not line or line[0] in "#<":
            prose.append("")
        elif item:
            prose.append(item[1])
        else:
            prose[-1] += f" {line}"
    return [block.strip() for block in prose], cells


def long_sentences(text: str) -> list[str]:
    prose, cells = prose_and_cells(text)
    sentences = [part for block in prose + cells for part in re.split(r"(?<=[.!?])[)*\"]*\s+", block)]
    return [
        part for part in sentences if len(re.findall(r"\S*[^\W_]\S*", part)) > MAX_SENTENCE and re.search("[a-z]", part)
    ]


def crowded_paragraphs(text: str) -> list[str]:
    return [block for block in prose_and_cells(text)[0] if len(QUANTITY.findall(block)) > MAX_MEASURED]


def num_words(document: str) -> int:
    return len(read(document).split())


@pytest.mark.parametrize("document", DOCUMENTS)
def test_sentences_are_short(document: str) -> None:
    assert long_sentences(read(document)) == []


@pytest.mark.parametrize("document", DOCUMENTS)
def test_measured_numbers_are_in_tables(document: str) -> None:
    assert crowded_paragraphs(read(document)) == []


def test_all_documents_have_few_words() -> None:
    counted = [name for name in DOCUMENTS if not name.startswith("bitstream_spec/") and "MODEL_CARD" not in name]
    assert sum(map(num_words, counted)) <= MAX_WORDS


@pytest.mark.parametrize(("document", "most"), MAX_WORDS_OF.items())
def test_a_document_has_few_words(document: str, most: int) -> None:
    assert num_words(document) <= most


def test_what_the_checks_find() -> None:
    long = "word " * MAX_SENTENCE + "end."
    assert long_sentences(f"Short. {long}\n- {long}\n\n| a | {long} |\n") == [long] * 3
    assert long_sentences(f"```\n{long}\n```\nOne `{long}` and [{long}](x.md).\n| {'1 ' * 40} |") == []
    assert long_sentences(f"{'word ' * MAX_SENTENCE}\n\nIs another paragraph.") == []
    text = "5 dB, 3%,\n0.1 s and 7 KiB.\n\n5 dB, 3 views and 2%.\n| 1% | 2% | 3% | 4% |"
    assert crowded_paragraphs(text) == ["5 dB, 3%, 0.1 s and 7 KiB."]


HOOK = Path(__file__).resolve().parent.parent / ".githooks" / "commit-msg"


def refusal(message: str, folder: Path) -> str:
    """What the hook prints on stderr; empty if it accepts the message."""
    path = folder / "message"
    path.write_text(message)
    result = subprocess.run([HOOK, path], capture_output=True, text=True)
    assert result.returncode == bool(result.stderr)
    return result.stderr


@pytest.mark.parametrize(
    "message", ["x" * 72 + "\n\n" + "y" * 100, "# comment of git\n\nAdd SOG export\n", "Merge " + "x" * 100]
)
def test_short_subjects_are_accepted(message: str, tmp_path: Path) -> None:
    assert refusal(message, tmp_path) == ""


def test_long_subjects_are_refused(tmp_path: Path) -> None:
    assert refusal("x" * 73, tmp_path).startswith("the subject has 73 characters; shorten it to 72")
