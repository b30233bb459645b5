"""The command group, which imports a command's module only when that command is run."""

from importlib import import_module

import click

from fecocodec import __version__

from .main import COMMANDS


class LazyGroup(click.Group):
    """Click group with lazy subcommands: the libraries of one command do not slow down the start of another."""

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
    epilog="Run `fecosplat COMMAND --help` for the options of a command and examples.",
)
@click.version_option(__version__, prog_name="fecosplat", message="%(prog)s %(version)s")
def command_line() -> None:
    """Compress posed photographs of a scene to a small .fcs file, and decode that file to 3D Gaussians.

    \b
      fecosplat encode photos/ -o scene.fcs     photographs and cameras -> a file of a few kilobytes
      fecosplat decode scene.fcs -o scene.ply   the file -> 3D Gaussians for any 3DGS viewer
    """
