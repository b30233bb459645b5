"""The report of `fecosplat encode`: size and quality of the file, per stage and in all."""

from typing import TYPE_CHECKING

from fecocodec.container import StreamSummary

from .output import say
from .terminal import printable

NEW_VIEWS = "3 to 8"  # dB, the middle two thirds of the entries of `make report` at lambda 1e-3

if TYPE_CHECKING:
    from fecocodec import DecodedQuality


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


def say_result(
    first_line: str, summary: StreamSummary, quality: "tuple[DecodedQuality, ...]", names: tuple[str, ...]
) -> None:
    """Print the size of the file, and for each stage its size and the PSNR of the decoded context views after it."""
    say(first_line)
    other = summary.total_bytes / 1024 - sum(_stage_kib(summary))
    say(f"  header, cameras and the like: {other:.2f} KiB")
    detail = _detail_kib(summary)
    for stage, (kib, after) in enumerate(zip(_stage_kib(summary), quality, strict=True), start=1):
        of_detail = f" ({detail:.2f} KiB of it detail)" if detail and stage == len(quality) else ""
        say(f"  stage {stage}: {kib:8.2f} KiB  {after.psnr:6.2f} dB{of_detail}")
    worst, name = min(zip(quality[-1].psnr_of_view, names, strict=True))
    count = len(names)
    size = f"{summary.header.width}x{summary.header.height}"
    of_worst = f" (worst {worst:.2f} dB, {printable(name)})"
    views = f"coded view of {size}" if count == 1 else f"{count} coded views of {size}{of_worst}"
    say(f"  in all:  {summary.total_bytes / 1024:8.2f} KiB  {quality[-1].psnr:6.2f} dB, PSNR of the {views} as decoded")
    if count > 1:
        say(f"  new views between these usually have {NEW_VIEWS} dB less")


def _stage_kib(summary: StreamSummary) -> list[float]:
    """Return the size of each stage in KiB. Detail counts as a part of the last one."""
    sizes = [section.total_bytes / 1024 for section in summary.sections if section.name in ("B1", "B2")]
    sizes[-1] += _detail_kib(summary)
    return sizes


def _detail_kib(summary: StreamSummary) -> float:
    return sum(section.total_bytes / 1024 for section in summary.sections if section.name == "detail")
