"""Entry point: finds the command, and turns every foreseen failure into one sentence and an exit code.

Exit codes: 0 done, 1 the input or output cannot be used, 2 wrong usage, 3 only part of a damaged file could be decoded
(`decode --partial`), 130 interrupted.
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

import click

from fecocodec import FecoError, __version__

from .process import prepare_process
from .terminal import printable

COMMANDS = ("encode", "decode", "info", "render", "train", "eval", "stress")
INTERRUPTED = 130


class LazyGroup(click.Group):
    """Imports a command's file when the command is named, so that one command's libraries never slow another."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f".{cmd_name}", __package__).command
        return command


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="`fecosplat COMMAND --help` shows the options of a command, with examples.",
)
@click.version_option(__version__, prog_name="fecosplat", message="%(prog)s %(version)s")
def command_line() -> None:
    """Compress posed photographs of a scene into a small .fcs file, and decode it to 3D Gaussians.

    \b
      fecosplat encode photos/ -o scene.fcs     photographs with cameras -> a few kilobytes
      fecosplat decode scene.fcs -o scene.ply   -> Gaussians for any 3DGS viewer
    """


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line (the process's own where none is given) and return its exit code."""
    try:
        code = command_line.main(arguments, prog_name="fecosplat", standalone_mode=False)
    except FecoError as error:
        click.echo(f"fecosplat: {printable(str(error))}", err=True)
        return 1
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort:
        click.echo("fecosplat: interrupted", err=True)
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def main() -> NoReturn:
    """The console script."""
    prepare_process()
    sys.exit(run())
