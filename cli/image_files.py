"""Names of the image files of a rendering, and writing all of them or none."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from fecocodec.atomic import made_folder, require_writable
from fecocodec.errors import OutputError

from .paths import require_ending

if TYPE_CHECKING:
    from fecocodec import Rendering

FOLDER_SUFFIXES = (".png", ".exr")  # written per view to a folder: sRGB colour, and linear colour with depth
FILE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".exr")  # accepted for a single output file


def is_image_file(output: Path) -> bool:
    """Return whether an output path is a single image, not a folder."""
    return output.suffix.lower() in FILE_SUFFIXES and not os.path.isdir(output)


def require_image_output(output: Path) -> None:
    """Raise OutputError if an output path is neither an image nor a folder, nor the name of one."""
    if is_image_file(output) or os.path.isdir(output):
        return
    if output.suffix.lower() == ".mp4":
        raise OutputError(f"{output}: -o is for images; use --video {output}.")
    require_ending(output, ("a folder", *FILE_SUFFIXES))
    if os.path.isfile(output):
        raise OutputError(f"{output}: is a file; give a folder, or a name that ends in .png, .jpg, .webp or .exr.")


def image_files(output: Path, stem: str, names: tuple[str, ...], *, overwrite: bool) -> list[list[Path]]:
    """Return the files to write for each view. Raises OutputError if one of them cannot be written.

    output: a folder, or the file for a single view (see `is_image_file`). stem: first part of the file names in a
    folder. names: of the views, second part of the file names.
    """
    is_image = is_image_file(output)
    if is_image and len(names) != 1:
        raise OutputError(
            f"{output}: one file cannot hold {len(names)} views; give a folder, or with --cameras the file name or the "
            "number of one view, such as --views 7, (7 without the comma is a count)."
        )
    files = (
        [[output]]
        if is_image
        else [[output / f"{stem}_{name}{suffix}" for suffix in FOLDER_SUFFIXES] for name in names]
    )
    if is_image or os.path.isdir(output):
        for file in (file for of_view in files for file in of_view):
            require_writable(file, overwrite=overwrite)
    return files


@contextmanager
def image_writer(files: list[list[Path]], *, overwrite: bool) -> Iterator[Callable[[list[Path], "Rendering"], None]]:
    """Yield a function that writes the rendering of one view to its files. The folder is created if it does not exist.

    files: of all views. If a file cannot be written, the new files are removed. A file that existed before then holds
    either its old or its new contents, each complete. Raises OutputError.
    """
    from fecocodec.photographs.exr import write_exr
    from fecocodec.photographs.images import write_image

    def write(of_view: list[Path], rendering: "Rendering") -> None:
        color, depth = rendering.color[0], rendering.depth[0]
        for file in of_view:
            if file.suffix.lower() == ".exr":
                write_exr(file, color, depth, overwrite=overwrite)
            else:
                write_image(file, color, overwrite=overwrite)

    with made_folder(files[0][0].parent), _all_or_none([file for of_view in files for file in of_view]):
        yield write


@contextmanager
def _all_or_none(files: list[Path]) -> Iterator[None]:
    """Remove those of the files that did not exist before if the block raises."""
    new = [file for file in files if not file.exists()]
    try:
        yield
    except BaseException:
        for file in new:
            file.unlink(missing_ok=True)
        raise
