"""How much work a report is."""

from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True)
class ReportPlan:
    """root, index: scenes and evaluation index. model: folder of the weights. work: results, kept for the next time.

    output: folder that gets `report.md` and `report/`. entries: pairs for rate and quality; speed_entries: of these for
    seconds; complexity_entries: pairs for bytes against complexity, None: all; entries_of_more_views: others, coded at
    one lambda; stress_scenes: pairs that stress cases are made from, 0: no stress cases.
    few_lambdas: for all but the main curve. sides, view_counts: image sizes and numbers of views of the scaling study.
    """

    root: Path
    index: Path
    model: Path
    work: Path
    output: Path
    entries: int = 12
    speed_entries: int = 3
    complexity_entries: int | None = None
    entries_of_more_views: int = 4
    stress_scenes: int = 1
    lambdas: tuple[float, ...] = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5)
    few_lambdas: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    sides: tuple[int, ...] = (64, 128, 256, 512, 1024)
    view_counts: tuple[int, ...] = (1, 2, 4, 8, 16)
    room_side: int = 256
    num_waves: tuple[int, ...] = (0, 1, 2, 4, 8, 16, 24)
    size: tuple[int, int] | None = None


def quick(plan: ReportPlan) -> ReportPlan:
    """The same report from a few small images: a test that it can be made, without meaningful numbers."""
    return replace(
        plan,
        entries=1,
        speed_entries=1,
        complexity_entries=1,
        entries_of_more_views=1,
        stress_scenes=0,
        lambdas=(1e-2, 1e-3),
        few_lambdas=(1e-2, 1e-3),
        sides=(64, 128),
        view_counts=(1, 2),
        room_side=64,
        num_waves=(0, 24),
        size=(96, 96),
    )
