"""The group of all commands, which imports a command's module only when it runs, and the options of every command."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from fecocodec import __version__

from .config_file import set_defaults
from .main import COMMANDS
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


class LazyGroup(click.Group):
    """Click group with lazy subcommands: the libraries of one command do not slow down the start of another.

    modules: the module of each command, which defines it as `command`.
    """

    def __init__(self, *arguments: Any, modules: Mapping[str, str], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.modules = modules

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.modules)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.modules:
            return None
        command: click.Command = import_module(f".{self.modules[cmd_name]}", __package__).command
        if not isinstance(command, click.Group):
            add_common_options(command)
        return command


@click.group(
    cls=LazyGroup,
    modules={name: name for name in COMMANDS},
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Run `fecosplat COMMAND --help` for the options of a command and examples.",
)
@click.version_option(__version__, prog_name="fecosplat", message="%(prog)s %(version)s")
def command_line() -> None:
    """Compress photographs of a scene to a small .fcs file, and decode that file to 3D Gaussians.

    \b
      fecosplat encode photos/ -o scene.fcs     photographs, cameras given or estimated -> some kilobytes
      fecosplat decode scene.fcs -o scene.ply   the file -> 3D Gaussians for any 3DGS viewer
    """
