"""Files, headings, commands, options, make targets and numbers that the documents name exist."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from fecosplat_cli.command_line import command_line
from fecosplat_cli.main import COMMANDS

import fecocodec

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = (
    "README.md",
    "DEVELOPMENT.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "fecocodec/weights/compact-6/MODEL_CARD.md",
    *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
)
WITH_COMMANDS = (
    "README.md",
    "docs/batch.md",
    "docs/command_line.md",
    "docs/inputs.md",
    "docs/limits.md",
    "docs/training.md",
)
BELOW = {"batch": ("encode", "decode"), "train": ("entropy", "steps", "detail")}
LISTED_ELSEWHERE = {"--help", "--version", "--index", "--output"}  # in the table of commands, or of every command
COMMANDS_OF_TABLE = ("encode", "decode", "render", "batch")  # whose options are all in docs/command_line.md


def help_of(command: str) -> str:
    """The help of a command, and of the commands below it."""
    below = BELOW.get(command, ())
    names = [[command], *([command, name] for name in below)]
    return "".join(CliRunner().invoke(command_line, [*name, "--help"]).output for name in names)


def option_rows() -> list[tuple[set[str], set[str]]]:
    """(options, commands) of each row of the table of options; a row of "all but X" has every other command."""
    rows = re.findall(r"^\| (`--.+?) \| ([a-z, ]+) \| ", (ROOT / "docs/command_line.md").read_text(), re.MULTILINE)
    parsed = []
    for options, names in rows:
        is_all = names.startswith("all")
        commands = set(COMMANDS) - set(names.removeprefix("all but ").split(", ")) if is_all else set(names.split(", "))
        parsed.append((set(re.findall(r"--[a-z-]+", options)), commands))
    return parsed


def anchors_of(path: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_to_files_and_headings(document: str) -> None:
    path = ROOT / document
    links = re.findall(r"\]\((?!https?://)([^)#\s]*)(?:#([^)\s]+))?\)", path.read_text())
    assert [target for target, _ in links if not (path.parent / target).exists()] == []
    inside = [(path.parent / target if target else path, anchor) for target, anchor in links if anchor]
    assert [anchor for target, anchor in inside if anchor not in anchors_of(target)] == []


@pytest.mark.parametrize("document", ["README.md", "fecocodec/weights/compact-6/MODEL_CARD.md"])
def test_scores_are_those_of_the_report(document: str) -> None:
    """Numbers of quality stand in docs/report.md; other tables repeat its rows as they are."""
    rows = re.findall(r"^\| (?:lambda|\d+e-\d) \|.*$", (ROOT / document).read_text(), re.MULTILINE)
    assert len(rows) > 3 and set(rows) <= set((ROOT / "docs/report.md").read_text().splitlines())


def test_the_citation_names_this_version() -> None:
    assert f"version: {fecocodec.__version__}\n" in (ROOT / "CITATION.cff").read_text()


@pytest.mark.parametrize("document", WITH_COMMANDS)
def test_commands_and_their_options_exist(document: str) -> None:
    """Every `fecosplat COMMAND ... --option` is one that `fecosplat COMMAND --help` lists."""
    unknown = []
    for line in re.findall(r"fecosplat ([a-z]+[^`#\n]*)", (ROOT / document).read_text()):
        command, _, arguments = line.partition(" ")
        shown = help_of(command) if command in COMMANDS else ""
        unknown += [f"{command} {option}" for option in re.findall(r"--[a-z-]+", arguments) if option not in shown]
        unknown += [] if command in COMMANDS else [command]
    assert unknown == []


@pytest.mark.parametrize(("options", "commands"), option_rows(), ids=lambda names: " ".join(sorted(names)))
def test_listed_options_exist(options: set[str], commands: set[str]) -> None:
    missing = [
        f"{command} {option}" for command in sorted(commands) for option in options if option not in help_of(command)
    ]
    assert missing == []


@pytest.mark.parametrize("command", COMMANDS_OF_TABLE)
def test_every_option_is_listed(command: str) -> None:
    listed = {option for options, commands in option_rows() if command in commands for option in options}
    options = set(re.findall(r"^ +(?:-[a-z], )?(--[a-z-]+)", help_of(command), re.MULTILINE))
    assert options - listed - LISTED_ELSEWHERE == set()


def test_the_tree_names_every_package_and_module() -> None:
    tree = (ROOT / "DEVELOPMENT.md").read_text().split("## Tree")[1].split("## Rules")[0]
    found = {path.name for path in (ROOT / "fecocodec").glob("*.py") if not path.name.startswith("__")}
    found |= {f"{path.parent.name}/" for path in (ROOT / "fecocodec").glob("*/__init__.py")}
    assert [name for name in sorted(found) if not re.search(rf"(?:^  |, ){re.escape(name)}", tree, re.MULTILINE)] == []


@pytest.mark.parametrize("target", re.findall(r"`make ([a-z-]+)`", (ROOT / "DEVELOPMENT.md").read_text()))
def test_make_targets_exist(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
