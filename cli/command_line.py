"""The command group of all commands."""

import click

from fecocodec import __version__

from .lazy_group import LazyGroup
from .main import COMMANDS


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
