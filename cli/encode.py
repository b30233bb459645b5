"""`fecosplat encode`: encode a folder of photographs to a .fcs file."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from fecocodec.atomic import require_other_file, require_writable, write_atomically, write_folder_atomically
from fecocodec.captures.view_selection import is_choice_left
from fecocodec.codec.options import DEFAULT_FRAMES
from fecocodec.container import inspect
from fecocodec.limits import DEFAULT_MAX_PIXELS

from .encode_options import encoding_options, options_of, usage_errors
from .encoding_report import report_fields, roles_note, say_result
from .info import summary_fields
from .options import FILE_PATH, json_option, num_threads
from .output import in_options, print_json, say, warn
from .paths import require_ending, require_model, require_photographs
from .progress import progress_bar
from .terminal import printable


@click.command(
    "encode",
    short_help="Compress a folder of photographs to a .fcs file.",
    epilog="""\b
Examples:
  fecosplat encode photos/ -o scene.fcs
  fecosplat encode photos/ -o scene.fcs --views 0,5 --size 256x256
  fecosplat encode photos/ -o scene.fcs --views left.jpg,right.jpg --lambda 1e-2
  fecosplat encode photos/ -o scene.fcs --views spread:4 --near 0.5 --far 20
  fecosplat encode photos/ -o scene.fcs --target-kib 8
  fecosplat encode photos_without_cameras/ -o scene.fcs --save-cameras transforms.json
  fecosplat encode clip.mp4 -o scene.fcs --views 4 --save-frames frames/""",
)
@click.argument("views_folder", metavar="VIEWS", type=FILE_PATH)
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Output file (.fcs).")
@click.option(
    "--frames",
    "num_frames",
    type=click.IntRange(2, 60),
    metavar="NUMBER",
    help="Number of sharp, evenly spread frames to take from a video, for its cameras; --views N codes N of them, and "
    f"others guide.  [default: {DEFAULT_FRAMES}, or all of fewer]",
)
@click.option(
    "--save-cameras",
    "cameras_file",
    type=FILE_PATH,
    metavar="FILE.json",
    help="Write the cameras estimated for photographs without cameras, in the layout of nerfstudio (transforms.json).",
)
@click.option(
    "--save-frames",
    "frames_folder",
    type=FILE_PATH,
    metavar="FOLDER",
    help="Write the frames that were taken from a video, as PNG, with their cameras to a new folder, which encodes to "
    "the same scene.",
)
@click.option(
    "--focal-px",
    type=float,
    metavar="NUMBER",
    help="Known focal length of photographs without cameras, in pixels of the photographs as they are.  [default: "
    "estimated]",
)
@encoding_options
@json_option
@usage_errors()
def command(
    views_folder: Path,
    output: Path,
    cameras_file: Path | None,
    frames_folder: Path | None,
    num_frames: int | None,
    focal_px: float | None,
    overwrite: bool,
    as_json: bool,
    **values: Any,
) -> None:
    """Compress the photographs in the folder VIEWS to a .fcs file.

    VIEWS contains images (PNG, JPEG, WebP, EXR) and their cameras: a transforms.json (nerfstudio, instant-ngp), a
    COLMAP sparse model, or a RealEstate10K camera file. Without cameras, or for a video, they are estimated (needs the
    `poses` extra).
    """
    require_writable(output, overwrite=overwrite)
    require_other_file(output, views_folder)
    require_ending(output, (".fcs",))
    options = options_of(values, num_frames=num_frames, focal_px=focal_px, num_threads=num_threads(-1))
    require_photographs(views_folder)
    require_model(values["model"])
    if cameras_file is not None:
        require_writable(cameras_file, overwrite=overwrite)
        require_ending(cameras_file, (".json",))
        require_other_file(cameras_file, views_folder)

        from fecocodec.codec.scene_source import require_no_cameras

        require_no_cameras(views_folder, "save_cameras")

    from fecocodec.codec.encode_folder import encode_folder

    with progress_bar() as on_progress, ExitStack() as stack:

        def write(data: bytes) -> None:
            """Write the file, which appears when the block ends, so that a warning under --strict leaves none."""
            stack.enter_context(write_atomically(output, overwrite=overwrite)).write_bytes(data)

        frames = None if frames_folder is None else stack.enter_context(write_folder_atomically(frames_folder))
        report = encode_folder(
            views_folder,
            replace(options, frames_folder=frames),
            on_progress=on_progress,
            on_note=lambda sentence: say(printable(f"note: {in_options(sentence)}")),
            on_warning=lambda sentence: warn(printable(f"warning: {in_options(sentence)}")),
            on_data=write,
        )
        if report.save_cameras is not None and frames is not None:
            report.save_cameras(frames / "transforms.json")
        if report.save_cameras is not None and cameras_file is not None:
            of_frames = {} if frames_folder is None else {"frames": frames_folder}
            report.save_cameras(cameras_file, overwrite=overwrite, **of_frames)
            if not views_folder.is_dir() and frames is None:
                say(f"note: {cameras_file}: the frames of the video are not saved; --save-frames FOLDER saves them.")
    summary = inspect(report.data)
    if summary.header.num_pixels > DEFAULT_MAX_PIXELS:
        warn(f"note: {output}: decode needs --max-pixels {summary.header.num_pixels} for this file.")
    if as_json:
        fields = {"output": str(output), "seconds": report.seconds, **summary_fields(summary)}
        print_json({**fields, **report_fields(report, summary)})
        return
    if note := roles_note(report, is_chosen=is_choice_left(options.views)):
        say(printable(f"note: {note}"))
    say_result(str(output), report, summary, views_folder)
