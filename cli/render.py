"""`fecosplat render`: render Gaussians to PNG (sRGB colour) and EXR (linear colour and depth)."""

from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import click

from fecocodec.container import read_header, read_stream_file

from .image_files import image_files, write_image_files
from .naming import naming
from .options import (
    FILE_PATH,
    device_option,
    json_option,
    max_pixels_option,
    model_option,
    overwrite_option,
    parse_size,
    threads_option,
)
from .output import print_json, say
from .paths import require_input, require_photographs
from .progress import progress_bar
from .selection import Selection, parse_selection, resolve

if TYPE_CHECKING:
    from fecocodec import Cameras

BACKGROUNDS = {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}


@click.command(
    "render",
    short_help="Render a .fcs or .ply file to images.",
    epilog="""\b
Examples:
  fecosplat render scene.fcs -o images/
  fecosplat render scene.fcs -o new_view.png --cameras photos/ --views 7
  fecosplat render scene.ply -o images/ --cameras photos/ --size 512x512""",
)
@click.argument("scene", metavar="FILE", type=FILE_PATH)
@click.option(
    "-o",
    "--output",
    required=True,
    type=FILE_PATH,
    help="Output folder, or a .png, .jpg, .webp or .exr file for a single view.",
)
@click.option(
    "--cameras",
    "cameras_folder",
    type=FILE_PATH,
    help="Folder of photographs; render their cameras.  [default: the cameras in the .fcs file]",
)
@click.option(
    "--views",
    callback=parse_selection,
    metavar="WHICH",
    help="Views of --cameras to render: 0,5 or a.jpg,b.jpg or spread:N or auto.  [default: all]",
)
@click.option(
    "--size", callback=parse_size, metavar="WxH", help="Image size for --cameras.  [default: that of the photographs]"
)
@click.option("--stages", type=click.IntRange(1, 2), help="Number of stages to decode.  [default: all]")
@click.option(
    "--background",
    type=click.Choice(list(BACKGROUNDS)),
    default="black",
    show_default=True,
    help="Colour of pixels that no Gaussian covers.",
)
@model_option
@max_pixels_option
@device_option
@threads_option
@overwrite_option
@json_option
def command(
    scene: Path,
    output: Path,
    cameras_folder: Path | None,
    views: Selection | None,
    size: tuple[int, int] | None,
    stages: int | None,
    background: str,
    model: Path | None,
    max_pixels: int,
    device: str,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Render the Gaussians of FILE (.fcs or .ply) to PNG and EXR images.

    PNG files contain sRGB colour. EXR files contain linear colour and, in channel Z, the depth along the optical axis
    in scene units.
    """
    is_ply = scene.suffix.lower() == ".ply"
    if cameras_folder is None and (views or size or is_ply):
        raise click.UsageError("A .ply file, --views and --size need --cameras FOLDER.")
    if is_ply and (stages or model):
        raise click.UsageError("--stages and --model say how a .fcs file is decoded; leave them out for a .ply file.")
    start = perf_counter()
    require_input(scene)
    if cameras_folder is not None:
        require_photographs(cameras_folder)
    _require_device(device, scene)
    data = b"" if is_ply else read_stream_file(scene)
    if cameras_folder is None:
        with naming(scene):
            names = tuple(f"{view:02d}" for view in range(read_header(data).header.num_views))
    else:
        cameras, image_size, names = _cameras_of_folder(cameras_folder, views, size)
    files = image_files(output, scene.stem, names, overwrite=overwrite)

    from fecocodec import decode, read_ply, render

    with progress_bar() as on_progress:
        if is_ply:
            gaussians = read_ply(scene).to(device)
        else:
            with naming(scene):
                decoded = decode(
                    data,
                    stages=stages or "all",
                    device=device,
                    model=model,
                    max_pixels=max_pixels,
                    on_progress=on_progress,
                )
            gaussians = decoded.gaussians
            if cameras_folder is None:
                cameras, image_size = decoded.cameras, decoded.image_size
        on_progress("rendering", 1.0)
        rendering = render(gaussians, cameras, image_size, BACKGROUNDS[background])
        write_image_files(rendering, files, overwrite=overwrite)
    seconds = round(perf_counter() - start, 3)
    written = [str(file) for of_view in files for file in of_view]
    if as_json:
        print_json({"outputs": written, "gaussians": gaussians.count, "seconds": seconds})
    else:
        say(f"{output}: {len(files)} {'view' if len(files) == 1 else 'views'} rendered in {seconds:.2f} s")


def _cameras_of_folder(
    folder: Path, selection: Selection | None, size: tuple[int, int] | None
) -> tuple["Cameras", tuple[int, int], tuple[str, ...]]:
    """Return the selected cameras of a folder of photographs, (height, width) in pixels, and one name per view."""
    from fecocodec.formats.scene_folder import read_view_cameras

    cameras, image_size, files = read_view_cameras(folder, views=resolve(folder, selection), size=size)
    return cameras, image_size, _distinct(tuple(Path(name).stem for name in files))


def _distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return unique names: if two views share a name (left/a.png, right/a.png), each name gets a number in front."""
    if len(set(names)) == len(names):
        return names
    return tuple(f"{view:02d}_{name}" for view, name in enumerate(names))


def _require_device(name: str, scene: Path) -> None:
    from .device import require_device, require_rendering_device

    if scene.suffix.lower() == ".ply":
        require_rendering_device(name)
    else:
        require_device(name)  # for the networks; decoded Gaussians are rendered on the CPU
