"""`fecosplat render`: render Gaussians to PNG (sRGB colour), EXR (linear colour and depth) or a video."""

from contextlib import ExitStack
from pathlib import Path
from time import perf_counter

import click

from fecocodec.atomic import require_writable
from fecocodec.captures.view_selection import Selection
from fecocodec.container import check_pixels, read_header, read_stream_file
from fecocodec.errors import error_context, some_of

from .decode_options import decode_here
from .image_files import image_files, image_writer, is_image_file, require_image_output
from .options import (
    FILE_PATH,
    STREAM_PATH,
    device_option,
    json_option,
    max_pixels_option,
    model_option,
    overwrite_option,
    parse_selection,
    parse_size,
    threads_option,
)
from .output import print_json, say, warn
from .paths import require_ending, require_input, require_model
from .progress import progress_bar
from .viewpoints import DEFAULT_FPS, DEFAULT_FRAMES, PATH_NAMES, cameras_and_size, names_of, read_given_cameras

LEAST_SHOWN = 0.01  # mean opacity of a rendering, below which it shows nothing
BACKGROUNDS = {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}


@click.command(
    "render",
    short_help="Render a .fcs or .ply file to images or a video.",
    epilog="""\b
Examples:
  fecosplat render scene.fcs -o images/
  fecosplat render scene.fcs -o preview.webp
  fecosplat render scene.fcs -o new_view.png --cameras photos/ --views 7,
  fecosplat render scene.ply -o images/ --cameras photos/ --size 512x512
  fecosplat render scene.fcs --video orbit.mp4 --path orbit --size 1280x720
  fecosplat render scene.fcs --video flight.mp4 --cameras camera_path.json""",
)
@click.argument("scene", metavar="FILE", type=STREAM_PATH)
@click.option(
    "-o", "--output", type=FILE_PATH,
    help="Output folder, or a .png, .jpg, .webp or .exr file for a single view. Without --cameras and --path, a single "
    "image shows the view of the first coded camera.",
)  # fmt: skip
@click.option("--video", type=FILE_PATH, metavar="FILE.mp4", help="Output video; needs the `video` extra (PyAV).")
@click.option(
    "--cameras", "cameras_path", type=FILE_PATH,
    help="Cameras to render: a folder of photographs, a camera file, a COLMAP model, or a camera path of nerfstudio "
    "(JSON). The photographs are not needed.  [default: the cameras in the .fcs file]",
)  # fmt: skip
@click.option(
    "--path", "path_name", type=click.Choice(PATH_NAMES),
    help="Render a path near the cameras: a spiral around their mean, an orbit around the scene, or a path that passes "
    "through all of them, as the others do where the cameras see no common centre.  [default for --video without "
    "--cameras: between]",
)  # fmt: skip
@click.option(
    "--frames", type=click.IntRange(2, 10_000), help="Number of frames of --path.  [default: 120]", metavar="NUMBER"
)
@click.option(
    "--fps", type=click.FloatRange(1, 240), metavar="NUMBER",
    help=f"Frames per second of --video.  [default: that of the camera path, else {DEFAULT_FPS}]",
)  # fmt: skip
@click.option(
    "--views", callback=parse_selection, metavar="WHICH",
    help="Views of --cameras to use: how many (4), numbers (0,5; with a comma for one: 7,), file names (a.jpg,b.jpg), "
    "auto or all.  [default: all]",
)  # fmt: skip
@click.option("--size", callback=parse_size, metavar="WxH", help="Image size.  [default: that of the photographs]")
@click.option("--stages", type=click.IntRange(1, 2), help="Number of stages to decode.  [default: all]")
@click.option(
    "--background", type=click.Choice(list(BACKGROUNDS)), default="black",
    help="Colour of pixels that no Gaussian covers.",
)  # fmt: skip
@model_option
@max_pixels_option
@device_option
@threads_option
@overwrite_option
@json_option
def command(
    scene: Path,
    output: Path | None,
    video: Path | None,
    cameras_path: Path | None,
    path_name: str | None,
    frames: int | None,
    fps: float | None,
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
    """Render the Gaussians of FILE (.fcs or .ply) to PNG and EXR images, or to a video.

    FILE may be - for a .fcs file from standard input. PNG files contain sRGB colour. EXR files contain
    linear colour and, in channel Z, the depth along the optical axis in scene units. The cameras of --cameras must have
    the coordinate frame and the unit of length of the encoded cameras.
    """
    is_ply = scene.suffix.lower() == ".ply"
    if output is None and video is None:
        raise click.UsageError("Give -o for images, --video for a video, or both.")
    if cameras_path is None and (views or is_ply):
        in_need = "A .ply file needs" if is_ply else "--views needs"
        raise click.UsageError(f"{in_need} --cameras, the cameras to render at.")
    if is_ply and (stages or model):
        raise click.UsageError("--stages and --model say how a .fcs file is decoded; leave them out for a .ply file.")
    if video is not None and cameras_path is None and path_name is None:
        path_name = "between"
    if (frames and path_name is None) or (fps and video is None):
        raise click.UsageError("--frames is for --path, and --fps for --video.")
    start = perf_counter()
    require_input(scene)
    require_model(model)
    if cameras_path is not None:
        require_input(cameras_path, "no such folder or file; give the folder that holds the cameras, or a camera file.")
    if output is not None:
        require_image_output(output)
    if video is not None:
        _require_video(video, overwrite=overwrite)
    data = b"" if is_ply else _stream_of(scene, max_pixels)
    _require_device(device, scene)
    if size is not None:
        from fecocodec.captures.render_cameras import require_rendering_size

        require_rendering_size(size)
    num_frames = None if path_name is None else frames or DEFAULT_FRAMES
    given = None if cameras_path is None else read_given_cameras(cameras_path, views, size)
    is_preview = output is not None and video is None and given is None and path_name is None and is_image_file(output)
    names = names_of(given, scene, data, num_frames)[: 1 if is_preview else None]
    files = [] if output is None else image_files(output, scene.stem, names, overwrite=overwrite)

    from fecocodec import Gaussians, read_ply
    from fecocodec.geometry.camera_paths import camera_path
    from fecocodec.photographs.video_writing import video_writer
    from fecocodec.rendering.rasterizer import render_each

    with progress_bar() as on_progress, ExitStack() as writers:
        decoded = None
        if not is_ply:
            with error_context(scene):
                decoded = decode_here(
                    data,
                    stages=stages or "all",
                    device=device,
                    model=model,
                    max_pixels=max_pixels,
                    on_progress=lambda task, fraction: on_progress(task, 0.5 * fraction),
                )
        gaussians = read_ply(scene).to(device) if decoded is None else Gaussians.of(decoded.gaussians)
        cameras, image_size = cameras_and_size(given, decoded, gaussians, size)
        if is_preview:
            cameras = cameras.select([0])
        if path_name is not None and num_frames is not None:
            cameras, note = camera_path(path_name, cameras, num_frames, gaussians.means.cpu())
            if note is not None:
                say(f"note: {note}")
        write_images = writers.enter_context(image_writer(files, overwrite=overwrite)) if files else None
        rate = fps or (given and given.frames_per_second) or DEFAULT_FPS
        add_frame = writers.enter_context(video_writer(video, image_size, rate, overwrite=overwrite)) if video else None
        empty = []
        for number, rendering in enumerate(render_each(gaussians, cameras, image_size, BACKGROUNDS[background])):
            if float(rendering.alpha.mean()) < LEAST_SHOWN:
                empty.append(names[number])
            on_progress("rendering", 0.5 + 0.5 * number / len(names))
            if write_images:
                write_images(files[number], rendering)
            if add_frame:
                add_frame(rendering.color[0].cpu())
    if empty:
        warn(
            f"warning: nothing of the scene is seen in {some_of(empty)}; give cameras in its frame and unit of length."
        )
    seconds = round(perf_counter() - start, 3)
    written = [str(file) for of_view in files for file in of_view] + ([str(video)] if video else [])
    count = f"{len(names)} {'view' if len(names) == 1 else 'views'}"
    if as_json:
        print_json({"outputs": written, "gaussians": gaussians.count, "seconds": seconds})
    else:
        say(f"{' and '.join(str(path) for path in (output, video) if path)}: {count} rendered in {seconds:.2f} s")


def _stream_of(scene: Path, max_pixels: int) -> bytes:
    """Return the bytes of a .fcs file whose header is valid and within the limit, before networks are loaded."""
    data = read_stream_file(scene)
    with error_context(scene):
        check_pixels(read_header(data).header, max_pixels)
    return data


def _require_video(video: Path, *, overwrite: bool) -> None:
    """Raise OutputError, before any work, if the video cannot be written."""
    from fecocodec.photographs.video_frames import require_video_extra

    require_ending(video, (".mp4",))
    require_writable(video, overwrite=overwrite)
    require_video_extra()


def _require_device(name: str, scene: Path) -> None:
    from fecocodec.layers.memory_format import usable_device
    from fecocodec.rendering.cuda import require_rendering_device

    if scene.suffix.lower() == ".ply":
        require_rendering_device(name)
    else:
        usable_device(name)  # for the networks; decoded Gaussians are rendered on the CPU
