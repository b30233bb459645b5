"""The group of commands: finds a command's file when it is named."""

from importlib import import_module

import click

from fecocodec import __version__

from .main import COMMANDS


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
