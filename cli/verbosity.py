"""How much a command prints on stderr: stored in the context of click by --quiet and --verbose."""

from enum import Enum

import click

_KEY = "fecosplat.verbosity"


class Verbosity(Enum):
    """QUIET: warnings and errors. NORMAL: also results and progress. VERBOSE: also each step."""

    QUIET = 0
    NORMAL = 1
    VERBOSE = 2


def set_verbosity(ctx: click.Context, value: Verbosity) -> None:
    """Set the verbosity of a command."""
    ctx.meta[_KEY] = value


def verbosity() -> Verbosity:
    """Return the verbosity of the running command; NORMAL outside of one."""
    ctx = click.get_current_context(silent=True)
    value = Verbosity.NORMAL if ctx is None else ctx.meta.get(_KEY, Verbosity.NORMAL)
    assert isinstance(value, Verbosity)
    return value
