"""Errors are sentences: every text that the library raises ends with a full stop."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from fecocodec import errors

ROOT = Path(__file__).resolve().parent.parent
ERRORS = {name for name, value in vars(errors).items() if isinstance(value, type)}


def texts() -> Iterator[tuple[str, str]]:
    """Where an error is made, and the last literal piece of its text; texts that end in a variable are left out."""
    for file in [*(ROOT / "fecocodec").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text())):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ERRORS):
                continue
            text = node.args[0]
            last = text.values[-1] if isinstance(text, ast.JoinedStr) else text
            if isinstance(last, ast.Constant):
                yield f"{file.relative_to(ROOT)}:{node.lineno}", str(last.value)


def test_every_error_ends_with_a_full_stop() -> None:
    found = list(texts())
    assert len(found) > 100
    assert [place for place, text in found if not text.endswith(".")] == []


def test_the_library_names_arguments_not_options_of_the_command_line() -> None:
    """`in_options` replaces the names of arguments on the command line; from Python, an option would mean nothing."""
    pieces = [
        (f"{file.relative_to(ROOT)}:{node.lineno}", node.value)
        for file in (ROOT / "fecocodec").rglob("*.py")
        for node in ast.walk(without_docstrings(ast.parse(file.read_text())))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    named = [(place, text) for place, text in pieces if re.search(r"(?<![\w-])--[a-z]", text) and "report" not in place]
    assert len(pieces) > 1000
    assert named == []


def without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if (
            isinstance(body, list)
            and body
            and isinstance(body[0], ast.Expr)
            and isinstance(body[0].value, ast.Constant)
        ):
            body[0].value = ast.Constant(None)
    return tree
