"""The report of `fecosplat encode`: size of the file, and quality of coded views, guides and new views."""

from pathlib import Path
from typing import TYPE_CHECKING

from fecocodec.codec.messages import of_input
from fecocodec.container import StreamSummary
from fecocodec.sender.view_quality import DecodedQuality, photographs

from .output import in_options, say
from .terminal import printable

if TYPE_CHECKING:
    from fecocodec import EncodingReport


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
        on = f"{of_input(source, photographs(len(names)))}{_worst(names, new_views) if len(names) > 1 else ''}"
        on += ", to which lambda is fitted" if report.is_fitted else ""
        say(f"{'  new views:':25}{new_views.psnr:6.2f} dB, PSNR of new views, measured on {on}")
    if (left_out := report.left_out) is not None:
        of_share = f"where the others show them ({100 * left_out.share:.0f}% of their pixels)"
        say(f"{'  left out:':25}{left_out.psnr:6.2f} dB, PSNR of coded views without their own Gaussians, {of_share}")


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
    if not others:
        return ""
    coded = f"coded views: {', '.join(report.names)}; " if is_chosen else ""
    return f"{coded}of the others, {', '.join(others)}."


def _of_view(names: tuple[str, ...], quality: DecodedQuality | None) -> list[dict[str, object]]:
    of_views = () if quality is None else quality.psnr_of_view
    return [{"name": name, "psnr": round(psnr, 3)} for name, psnr in zip(names, of_views, strict=True)]


def _worst(names: tuple[str, ...], quality: DecodedQuality) -> str:
    worst = quality.worst_view
    return f" (worst {quality.psnr_of_view[worst]:.2f} dB, {printable(names[worst])})"


def _stage_kib(summary: StreamSummary) -> list[float]:
    """Return the size of each stage in KiB. Detail counts as a part of the last one."""
    sizes = [section.total_bytes / 1024 for section in summary.sections if section.name in ("B1", "B2")]
    sizes[-1] += _detail_kib(summary)
    return sizes


def _detail_kib(summary: StreamSummary) -> float:
    return sum(section.total_bytes / 1024 for section in summary.sections if section.name == "detail")
