"""The hook that `make` installs refuses commits whose subject is too long."""

import subprocess
from pathlib import Path

import pytest

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
