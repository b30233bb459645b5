"""`fecosplat web`: write the page that decodes .fcs files in the browser."""

from pathlib import Path

import click

from fecocodec.atomic import write_folder_atomically

from .options import FILE_PATH
from .output import say


@click.command(
    "web",
    short_help="Write the page that decodes .fcs files in the browser.",
    epilog="""\b
Examples:
  fecosplat web site/
  fecosplat web /var/www/splats
  cp scene.fcs site/
  python -m http.server --directory site""",
)
@click.argument("folder", metavar="OUT", type=FILE_PATH)
def command(folder: Path) -> None:
    """Write a folder for any web server: the page, its decoder, and the models that ship.

    The page decodes a .fcs file of the same server, so a scene is sent as kilobytes: put scene.fcs into the folder and
    open .../?file=scene.fcs. It loads nothing from other hosts.
    """
    from fecocodec.splat_files.html_page import decoding_page

    contents = decoding_page()
    with write_folder_atomically(folder) as temporary:
        for name, content in contents.items():
            path = temporary / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    size = f"{len(contents)} files, {sum(map(len, contents.values())) / 1e6:.1f} MB"
    say(f"{folder}: {size}; put .fcs files into it, and open ?file=NAME.fcs")
