"""Options of every command: --quiet, --verbose and --config-file."""

from pathlib import Path

import click

from .config_file import set_defaults
from .options import FILE_PATH
from .output import Verbosity, set_verbosity


def add_common_options(command: click.Command) -> None:
    """Add the options to a command that does not have them yet."""
    known = {parameter.name for parameter in command.params}
    command.params.extend(option for option in _options() if option.name not in known)


def _options() -> tuple[click.Option, ...]:
    return (
        click.Option(
            ["-q", "--quiet"],
            is_flag=True,
            expose_value=False,
            callback=_set_quiet,
            help="Print only warnings and errors on stderr.",
        ),
        click.Option(
            ["-v", "--verbose"],
            is_flag=True,
            expose_value=False,
            callback=_set_verbose,
            help="Print each step with its time on stderr.",
        ),
        click.Option(
            ["--config-file"],
            type=FILE_PATH,
            metavar="FILE.toml",
            is_eager=True,
            expose_value=False,
            callback=_set_defaults,
            help="Read default values of options from this file.",
        ),
    )


def _set_quiet(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        set_verbosity(ctx, Verbosity.QUIET)


def _set_verbose(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        set_verbosity(ctx, Verbosity.VERBOSE)


def _set_defaults(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    if value is not None:
        set_defaults(value, ctx)
