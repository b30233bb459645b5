"""`fecosplat encode`: encode a folder of photographs to a .fcs file."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fecocodec.atomic import require_other_file, require_writable, write_atomically, write_folder_atomically
from fecocodec.captures.view_selection import Auto, Spread
from fecocodec.codec.messages import of_input
from fecocodec.codec.options import DEFAULT_FRAMES
from fecocodec.container import StreamSummary, inspect
from fecocodec.errors import some_of
from fecocodec.limits import DEFAULT_MAX_PIXELS
from fecocodec.sender.view_quality import DecodedQuality, photographs

from .encode_options import encoding_options, options_of, usage_errors
from .info import summary_fields
from .options import FILE_PATH, json_option, num_threads
from .output import in_options, print_json, say, warn
from .paths import require_ending, require_model, require_photographs
from .progress import progress_bar

if TYPE_CHECKING:
    from fecocodec import EncodingReport


@click.command(
    "encode",
    short_help="Compress a folder of photographs to a .fcs file.",
    epilog="""\b
Examples:
  fecosplat encode photos/ -o scene.fcs
  fecosplat encode photos/ -o scene.fcs --views 0,5 --size 256x256
  fecosplat encode photos/ -o scene.fcs --views left.jpg,right.jpg --lambda 1e-2
  fecosplat encode photos/ -o scene.fcs --views 4 --near 0.5 --far 20
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
    """Compress the photographs in VIEWS, a folder, a ZIP archive, a camera file or a video, to a .fcs file.

    A folder contains images (PNG, JPEG, WebP, AVIF, TIFF, BMP, EXR, and HEIC with the `heic` extra) and their cameras:
    a transforms.json (nerfstudio, instant-ngp), a COLMAP sparse model, a RealEstate10K camera file, the cameras.json of
    3DGS, or the poses_bounds.npy of LLFF. The cameras of a video, or of a folder without a camera file, are estimated
    from the images (needs the `poses` extra, for a video also `video`).
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
        frames = None if frames_folder is None else stack.enter_context(write_folder_atomically(frames_folder))
        report = encode_folder(
            views_folder,
            replace(options, frames_folder=frames),
            on_progress=on_progress,
            on_note=lambda sentence: say(f"note: {in_options(sentence)}"),
            on_warning=lambda sentence: warn(f"warning: {in_options(sentence)}"),
        )
        stack.enter_context(write_atomically(output, overwrite=overwrite)).write_bytes(report.data)
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
    if note := roles_note(report, is_chosen=options.views is None or isinstance(options.views, Spread | Auto)):
        say(f"note: {note}")
    say_result(str(output), report, summary, views_folder)


def report_fields(report: "EncodingReport", summary: StreamSummary) -> dict[str, object]:
    """Return the JSON fields about quality and roles: PSNR in dB and KiB, in all, per stage and per view."""
    stages = zip(_stage_kib(summary), report.quality, strict=True)
    new_views = report.checks.quality
    return {
        "kib": round(summary.total_bytes / 1024, 3),
        "context_psnr": round(report.quality[-1].psnr, 3),
        "new_view_psnr": None if new_views is None else round(new_views.psnr, 3),
        "new_view_psnr_is_fitted": report.is_fitted,
        "left_out_psnr": None if report.left_out is None else round(report.left_out.psnr, 3),
        "stage_results": [{"kib": round(kib, 3), "context_psnr": round(after.psnr, 3)} for kib, after in stages],
        "context_views": _of_view(report.names, report.quality[-1]),
        "guide_views": _of_view(report.guides.names, report.guides.quality),
        "check_views": _of_view(report.checks.names, new_views),
        "warnings": [in_options(sentence) for sentence in report.warnings],
    }


def say_result(output: str, report: "EncodingReport", summary: StreamSummary, source: Path = Path()) -> None:
    """Print the size of the file, its size and PSNR after each stage, and the PSNR of new views. source: the input."""
    say(f"{output}: {summary.total_bytes / 1024:.2f} KiB in {report.seconds:.2f} s")
    other = summary.total_bytes / 1024 - sum(_stage_kib(summary))
    say(f"  header, cameras and the like: {other:.2f} KiB")
    detail, quality = _detail_kib(summary), report.quality
    for stage, (kib, after) in enumerate(zip(_stage_kib(summary), quality, strict=True), start=1):
        of_detail = f" ({detail:.2f} KiB of it detail)" if detail and stage == len(quality) else ""
        say(f"  stage {stage}: {kib:8.2f} KiB  {after.psnr:6.2f} dB{of_detail}")
    size = f"{summary.header.width}x{summary.header.height}"
    count = len(report.names)
    of_worst = f"{count} coded views of {size}{_worst(report.names, quality[-1])}"
    views = f"coded view of {size}" if count == 1 else of_worst
    say(f"  in all:  {summary.total_bytes / 1024:8.2f} KiB  {quality[-1].psnr:6.2f} dB, PSNR of the {views} as decoded")
    if (new_views := report.checks.quality) is not None:
        names = report.checks.names
        on = f"{of_input(source, photographs(len(names)))}, {some_of(names)}"
        on += _worst(names, new_views) if len(names) > 1 else ""
        on += ", to which lambda is fitted" if report.is_fitted else ""
        say(f"{'  new views:':25}{new_views.psnr:6.2f} dB, PSNR of new views, measured on {on}")
    if (left_out := report.left_out) is not None:
        share = f"where the others show them ({100 * left_out.share:.0f}% of their pixels)"
        of = f"PSNR of coded views without their own Gaussians, {share}"
        say(f"{'  from the others:':25}{left_out.psnr:6.2f} dB, {of}")


def roles_note(report: "EncodingReport", *, is_chosen: bool) -> str:
    """Return a sentence about what the photographs that are not coded are for; empty if there are none.

    is_chosen: whether the coded views were chosen for the user, and are thus to be named.
    """
    counts = (
        (len(report.guides.names), "guides the encoder", "guide the encoder"),
        (len(report.checks.names), "measures new views", "measure new views"),
        (report.num_unused, "is not used", "are not used"),
    )
    others = [f"{count} {one if count == 1 else more}" for count, one, more in counts if count]
    if reasons := "; ".join(f"{reason}: {some_of(names)}" for reason, names in report.unused.items()):
        others[-1] += f" ({in_options(reasons)})"
    if not others:
        return ""
    coded = f"coded views: {', '.join(report.names)}; " if is_chosen else ""
    return f"{coded}of the others, {', '.join(others)}."


def _of_view(names: tuple[str, ...], quality: DecodedQuality | None) -> list[dict[str, object]]:
    of_views = () if quality is None else quality.psnr_of_view
    return [{"name": name, "psnr": round(psnr, 3)} for name, psnr in zip(names, of_views, strict=True)]


def _worst(names: tuple[str, ...], quality: DecodedQuality) -> str:
    worst = quality.worst_view
    return f" (worst {quality.psnr_of_view[worst]:.2f} dB, {names[worst]})"


def _stage_kib(summary: StreamSummary) -> list[float]:
    """Return the size of each stage in KiB. Detail counts as a part of the last one."""
    sizes = [section.total_bytes / 1024 for section in summary.sections if section.name in ("B1", "B2")]
    sizes[-1] += _detail_kib(summary)
    return sizes


def _detail_kib(summary: StreamSummary) -> float:
    return sum(section.total_bytes / 1024 for section in summary.sections if section.name == "detail")
