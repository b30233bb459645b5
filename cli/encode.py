"""`fecosplat encode`: encode a folder of posed photographs to a .fcs file."""

from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import click

from fecocodec.container import StreamSummary, inspect, quantise_lambda
from fecocodec.formats.atomic import require_other_file, require_writable, write_atomically
from fecocodec.limits import DEFAULT_MAX_PIXELS

from .info import summary_fields
from .naming import OF_VIEWS, naming
from .options import FILE_PATH, device_option, json_option, model_option, overwrite_option, parse_size, threads_option
from .output import in_options, print_json, say
from .paths import require_ending, require_photographs
from .progress import progress_bar
from .rate_control import rate_control_options, target_of
from .selection import Selection, parse_selection, resolve
from .terminal import printable

if TYPE_CHECKING:
    from fecocodec.sender.decoded_quality import DecodedQuality


@click.command(
    "encode",
    short_help="Compress a folder of posed photographs to a .fcs file.",
    epilog="""\b
Examples:
  fecosplat encode photos/ -o scene.fcs
  fecosplat encode photos/ -o scene.fcs --views 0,5 --size 256x256
  fecosplat encode photos/ -o scene.fcs --views left.jpg,right.jpg --lambda 1e-2
  fecosplat encode photos/ -o scene.fcs --views spread:4 --near 0.5 --far 20
  fecosplat encode photos/ -o scene.fcs --target-kib 8""",
)
@click.argument("views_folder", metavar="VIEWS", type=FILE_PATH)
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Output file (.fcs).")
@click.option(
    "--lambda",
    "lmbda",
    type=float,
    default=1e-3,
    show_default=True,
    metavar="NUMBER",
    help="Rate-distortion trade-off, 1e-5 to 1e-2. A smaller value gives better quality and a larger file.",
)
@rate_control_options
@click.option(
    "--views",
    callback=parse_selection,
    metavar="WHICH",
    help="Views to encode: numbers (0,5), file names (a.jpg,b.jpg), spread:N for N overlapping views, or auto for at "
    "most eight overlapping views.  [default: all, or auto for more than 16 photographs]",
)
@click.option("--size", callback=parse_size, metavar="WxH", help="Centre-crop and resize to WIDTHxHEIGHT pixels.")
@click.option("--near", type=float, help="Nearest depth of the scene, in scene units.  [default: estimated]")
@click.option("--far", type=float, help="Farthest depth of the scene, in scene units.  [default: estimated]")
@click.option(
    "--background",
    type=click.Choice(["white", "black"]),
    help="Composite transparent photographs on this colour.  [default: transparent regions decode to no Gaussians]",
)
@click.option("--stages", type=click.IntRange(1, 2), default=2, show_default=True, help="Number of stages to encode.")
@click.option(
    "--effort",
    type=click.Choice(["fast", "default", "best"]),
    default="default",
    show_default=True,
    help="Encoding effort: more effort gives a smaller file at equal quality. fast takes about a third of the time of "
    "default, best about three times as long.",
)
@model_option
@device_option
@threads_option
@overwrite_option
@json_option
def command(
    views_folder: Path,
    output: Path,
    lmbda: float,
    target_kib: float | None,
    target_psnr: float | None,
    views: Selection | None,
    size: tuple[int, int] | None,
    near: float | None,
    far: float | None,
    background: Literal["white", "black"] | None,
    stages: int,
    effort: str,
    model: Path | None,
    device: str,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compress the photographs in the folder VIEWS to a .fcs file.

    VIEWS contains images (PNG, JPEG, WebP, EXR) and their cameras: a transforms.json (nerfstudio, instant-ngp), a
    COLMAP sparse model, or a RealEstate10K camera file.
    """
    start = perf_counter()
    require_writable(output, overwrite=overwrite)
    require_other_file(output, views_folder)
    require_ending(output, (".fcs",))
    quantise_lambda(lmbda)  # raises for a value outside the range, before any view is read
    target = target_of(target_kib, target_psnr, stages)
    require_photographs(views_folder)

    from fecocodec import check_input, encode, encode_to_target, measure_decoded, read_views

    from .device import require_device, require_rendering_device

    if stages == 1 and effort == "fast":
        require_device(device)
    else:
        require_rendering_device(device)  # optimisation and feedback render on this device
    chosen = resolve(views_folder, views)
    with progress_bar() as on_progress:
        on_progress("reading views", 0.0)
        scene = read_views(views_folder, views=chosen, size=size, near=near, far=far, background=background)
        with naming(views_folder, OF_VIEWS):
            if target is None:
                coder = partial(encode, lmbda=lmbda, num_stages=stages)
            else:
                coder = partial(encode_to_target, target=target)
            found: list[str] = []
            data = coder(
                scene, effort=effort, device=device, model=model, on_progress=on_progress, on_warning=found.append
            )
        on_progress("measuring quality", 1.0)
        quality = measure_decoded(data, scene, device=device, model=model)
    warnings = [in_options(text) for text in (*scene.notes, *check_input(scene, effort), *found)]
    for warning in warnings:  # only after all checks that can reject the views
        say(printable(f"warning: {warning}"))
    with write_atomically(output, overwrite=overwrite) as temporary:
        temporary.write_bytes(data)
    seconds = round(perf_counter() - start, 3)
    summary = inspect(data)
    if summary.header.num_pixels > DEFAULT_MAX_PIXELS:
        say(f"note: {output}: decode needs --max-pixels {summary.header.num_pixels} for this file.")
    if as_json:
        fields = quality_fields(summary, quality, scene.names)
        print_json(
            {"output": str(output), "seconds": seconds, **summary_fields(summary), **fields, "warnings": warnings}
        )
    else:
        say_result(f"{output}: {summary.total_bytes / 1024:.2f} KiB in {seconds:.2f} s", summary, quality)


def quality_fields(
    summary: StreamSummary, quality: "tuple[DecodedQuality, ...]", names: tuple[str, ...]
) -> dict[str, object]:
    """Return the JSON fields about quality: PSNR in dB and KiB, in all, per stage and per view."""
    stages = zip(_stage_kib(summary), quality, strict=True)
    of_view = zip(names, quality[-1].psnr_of_view, strict=True)
    return {
        "kib": round(summary.total_bytes / 1024, 3),
        "context_psnr": round(quality[-1].psnr, 3),
        "stage_results": [{"kib": round(kib, 3), "context_psnr": round(after.psnr, 3)} for kib, after in stages],
        "context_views": [{"name": name, "psnr": round(psnr, 3)} for name, psnr in of_view],
    }


def say_result(first_line: str, summary: StreamSummary, quality: "tuple[DecodedQuality, ...]") -> None:
    """Print the size of the file, and for each stage its size and the PSNR of the decoded context views after it."""
    say(first_line)
    for stage, (kib, after) in enumerate(zip(_stage_kib(summary), quality, strict=True), start=1):
        say(f"  stage {stage}: {kib:8.2f} KiB  {after.psnr:6.2f} dB")
    worst = min(quality[-1].psnr_of_view)
    count = len(quality[-1].psnr_of_view)
    views = "context view" if count == 1 else f"{count} context views (worst {worst:.2f} dB)"
    say(f"  in all:  {summary.total_bytes / 1024:8.2f} KiB  {quality[-1].psnr:6.2f} dB, PSNR of the decoded {views}")


def _stage_kib(summary: StreamSummary) -> list[float]:
    """Return the size of each stage's section in KiB."""
    return [section.total_bytes / 1024 for section in summary.sections if section.name in ("B1", "B2")]
