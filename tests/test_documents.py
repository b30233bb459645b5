"""What the documents promise exists."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from fecosplat_cli.main import COMMANDS, command_line

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = ("README.md", "DEVELOPMENT.md", "CHANGELOG.md")


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_to_files(document: str) -> None:
    targets = re.findall(r"\]\((?!https?://|#)([^)#]+)", (ROOT / document).read_text())
    assert [target for target in targets if not (ROOT / target).exists()] == []


def test_shown_commands_and_their_options_exist() -> None:
    """Every `fecosplat COMMAND ... --option` in the README is one that `fecosplat COMMAND --help` lists."""
    unknown = []
    for line in re.findall(r"fecosplat ([a-z]+[^`#\n]*)", (ROOT / "README.md").read_text()):
        command, _, arguments = line.partition(" ")
        shown = CliRunner().invoke(command_line, [command, "--help"]).output if command in COMMANDS else ""
        unknown += [f"{command} {option}" for option in re.findall(r"--[a-z]+", arguments) if option not in shown]
        unknown += [] if command in COMMANDS else [command]
    assert unknown == []


@pytest.mark.parametrize("target", re.findall(r"`make ([a-z-]+)`", (ROOT / "DEVELOPMENT.md").read_text()))
def test_shown_make_targets_exist(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
