"""`fecosplat encode`: encode a folder of photographs to a .fcs file."""

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Literal

import click

from fecocodec.atomic import require_other_file, require_writable, write_atomically
from fecocodec.captures.view_selection import Selection, may_leave_out
from fecocodec.container import inspect, quantise_lambda, with_metadata
from fecocodec.errors import strict_error
from fecocodec.limits import DEFAULT_MAX_PIXELS

from .encode_options import encoding_options, require_steps
from .encoding_report import quality_fields, say_result
from .error_context import OF_VIEWS, error_context
from .info import summary_fields
from .metadata_options import metadata_of
from .options import FILE_PATH, json_option
from .output import in_options, print_json, say, warn
from .paths import require_ending, require_model, require_photographs
from .progress import progress_bar
from .rate_control import target_of
from .scene_source import DEFAULT_FRAMES, require_cameras_file, scene_source
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
  fecosplat encode clip.mp4 -o scene.fcs --frames 8""",
)
@click.argument("views_folder", metavar="VIEWS", type=FILE_PATH)
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Output file (.fcs).")
@click.option(
    "--frames",
    "num_frames",
    type=click.IntRange(2, 60),
    metavar="NUMBER",
    help=f"Number of sharp, evenly spread frames to take from a video.  [default: {DEFAULT_FRAMES}]",
)
@click.option(
    "--save-cameras",
    "cameras_file",
    type=FILE_PATH,
    metavar="FILE.json",
    help="Write the cameras estimated for photographs without cameras, in the layout of nerfstudio (transforms.json).",
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
def command(
    views_folder: Path,
    output: Path,
    lmbda: float,
    target_kib: float | None,
    target_psnr: float | None,
    num_frames: int | None,
    cameras_file: Path | None,
    focal_px: float | None,
    views: Selection | None,
    size: tuple[int, int] | None,
    near: float | None,
    far: float | None,
    background: Literal["white", "black"] | None,
    stages: int,
    effort: str,
    sharpness: float,
    is_strict: bool,
    title: str | None,
    author: str | None,
    licence: str | None,
    date: str | None,
    model: Path | None,
    device: str,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compress the photographs in the folder VIEWS to a .fcs file.

    VIEWS contains images (PNG, JPEG, WebP, EXR) and their cameras: a transforms.json (nerfstudio, instant-ngp), a
    COLMAP sparse model, or a RealEstate10K camera file. Without cameras, or for a video, they are estimated (needs the
    `poses` extra).
    """
    start = perf_counter()
    require_writable(output, overwrite=overwrite)
    require_other_file(output, views_folder)
    require_ending(output, (".fcs",))
    require_steps(sharpness, effort)
    quantise_lambda(lmbda)  # raises for a value outside the range, before any view is read
    target = target_of(target_kib, target_psnr, stages)
    metadata = metadata_of(title, author, licence, date)
    require_photographs(views_folder)
    require_model(model)
    require_cameras_file(cameras_file, views_folder, overwrite=overwrite)

    from fecocodec.captures.chosen_photographs import choose_photographs
    from fecocodec.captures.reading_notes import scaling_remark

    if device != "cpu":  # the check loads torch
        from .device import require_encoding_device

        require_encoding_device(device, stages, effort)
    warnings: list[str] = []

    def report(warning: str) -> None:
        if is_strict:
            raise strict_error(str(views_folder), warning)
        warnings.append(in_options(warning))
        warn(printable(f"warning: {warnings[-1]}"))

    with progress_bar() as on_progress, ExitStack() as stack:
        on_progress("reading views", 0.0)
        source = stack.enter_context(
            scene_source(views_folder, num_frames, cameras_file, focal_px, overwrite=overwrite)
        )
        for note in source.notes:
            say(printable(note))
        for warning in source.warnings:
            report(warning)
        # What cameras and headers of images tell is reported before torch is loaded, and before any pixel is read.
        chosen = choose_photographs(source.path, views=views, size=size)
        for note in chosen.remarks:
            say(printable(f"note: {in_options(note)}"))
        for warning in chosen.notes:
            report(warning)
        if size is None and (remark := scaling_remark([pinhole for _, pinhole in chosen.lenses], chosen.image_size)):
            say(f"note: {remark}")

        from fecocodec import (
            check_input,
            encode,
            encode_to_target,
            measure_decoded,
            quality_warnings,
            without_harmful_views,
        )
        from fecocodec.captures.scene_folder import read_pixels
        from fecocodec.sender.decoded_quality import stage_warnings
        from fecocodec.sender.harmful_views import left_out_note

        scene = read_pixels(chosen, near=near, far=far, background=background)
        left_out: list[str] = []
        if may_leave_out(views):
            on_progress("judging views", 0.0)
            with error_context(views_folder, OF_VIEWS):
                scene = without_harmful_views(
                    scene, lmbda=lmbda, device=device, model=model, on_left_out=left_out.extend
                )
            if left_out:
                say(printable(f"note: {in_options(left_out_note(left_out))}"))
        if may_leave_out(views) and views is not None and not as_json:  # JSON names them anyway
            say(printable(f"note: coded views: {', '.join(scene.names)}."))
        for warning in check_input(scene, effort):
            report(warning)
        with error_context(views_folder, OF_VIEWS):
            if target is None:
                coder = partial(encode, lmbda=lmbda, num_stages=stages)
            else:
                coder = partial(encode_to_target, target=target)
            data = coder(
                scene,
                effort=effort,
                sharpness=sharpness,
                device=device,
                model=model,
                on_progress=on_progress,
                on_warning=report,
            )
        if metadata:
            data = with_metadata(data, metadata)
        with write_atomically(output, overwrite=overwrite) as temporary:
            temporary.write_bytes(data)
            quality = measure_decoded(data, scene, device=device, model=model)
            for warning in (*stage_warnings(quality), *quality_warnings(quality[-1], scene.names)):
                report(warning)
    seconds = round(perf_counter() - start, 3)
    summary = inspect(data)
    if summary.header.num_pixels > DEFAULT_MAX_PIXELS:
        warn(f"note: {output}: decode needs --max-pixels {summary.header.num_pixels} for this file.")
    if as_json:
        fields = quality_fields(summary, quality, scene.names)
        print_json(
            {
                "output": str(output),
                "seconds": seconds,
                **summary_fields(summary),
                **fields,
                "left_out_views": left_out,
                "warnings": warnings,
            }
        )
    else:
        say_result(f"{output}: {summary.total_bytes / 1024:.2f} KiB in {seconds:.2f} s", summary, quality, scene.names)
