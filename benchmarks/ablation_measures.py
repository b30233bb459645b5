"""How `ablate_training.py` judges a variant: by files of dev pairs, and by its losses while training."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from statistics import mean, stdev
from unittest.mock import patch

import torch

from fecocodec.evaluation.entries import open_scenes
from fecocodec.evaluation.novel_views import render_views
from fecocodec.formats.evaluation_index import read_index
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver import emission
from fecocodec.receiver.decode import MAX_SH_DEGREE, decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.encode import Profile, code_stages, encode_with, header_of
from fecocodec.sender.steps import (
    CodedStage,
    Latents,
    MatchedViews,
    PreparedScene,
    analyse,
    code_stage,
    feedback_features,
    match_views,
    prepare,
    stage_rendering,
)

HEADER = ("variant", "KiB", "stage 1", "both", "context", "d KiB", "d stage 1", "d both", "d context", "d loss")


@dataclass(frozen=True)
class Entry:
    """An evaluation pair as read once for all variants."""

    name: str
    views: Views
    num_context: int


@dataclass(frozen=True)
class Figures:
    """Of one entry: size of the whole file, PSNR in dB of the target views after stage 1 and after both stages, and of
    the context views after both.
    """

    kib: float
    first: float
    both: float
    context: float


@dataclass(frozen=True)
class Measured:
    """What a variant came to. losses: of the last half of the steps, comparable where `batches` are the same."""

    entries: list[Figures]
    losses: list[float]
    batches: tuple[float, int, bool]


def read_entries(root: Path, index: Path, count: int, size: tuple[int, int]) -> list[Entry]:
    """Two-view entries, evenly spread over the index."""
    pairs = [entry for entry in read_index(index) if len(entry.context) == 2]
    read = open_scenes(root, size)
    chosen = [pairs[place * len(pairs) // count] for place in range(min(count, len(pairs)))]
    return [Entry(entry.name, read(entry), len(entry.context)) for entry in chosen]


def measure(profile: Profile, entry: Entry, lambda_q: int, num_stages: int = 2) -> Figures:
    """An entry coded with two stages, as the networks make them, not refined; decoded whole, and up to stage 1.

    num_stages: with 3, `both` and `context` are after a third stage, whose bytes count, too.
    """
    context, every = list(range(entry.num_context)), range(entry.views.cameras.num_views)
    targets = entry.views.select([view for view in every if view not in context])
    coded = entry.views.select(context)
    data = encode_with(profile, coded, lambda_q, 2, refinement_steps=0)
    num_bytes = len(data)
    # Variants with Gaussians on another grid: entries are of whole cells, so that no Gaussian lies outside.
    with patch.object(emission, "inside_unpadded", lambda *_: torch.tensor(True)):
        first, both = (decode_with(profile.receiver, data, stages=stages).gaussians for stages in (1, 2))
        if num_stages == 3:
            more, both = code_third_stage(profile, coded, lambda_q)
            num_bytes += more
    rendered = psnr(render_views(both, entry.views), entry.views.images)
    return Figures(
        kib=num_bytes / 1024,
        first=float(psnr(render_views(first, targets), targets.images).mean()),
        both=float(rendered[len(context) :].mean()),
        context=float(rendered[: len(context)].mean()),
    )


@torch.inference_mode()
def code_third_stage(profile: Profile, views: Views, lambda_q: int) -> tuple[int, Gaussians]:
    """Bytes of a third stage, which streams cannot hold, and the Gaussians after it.

    Coded as the second stage is, with what the second leaves missing; a stage's entry in the header is not counted.
    """
    scene = prepare(profile, views)
    matched = match_views(profile, scene)
    first, second = code_stages(profile, scene, matched, lambda_q, 2, refinement_steps=0)
    latents = _missing(profile, scene, matched, second, lambda_q)
    third = code_stage(profile, scene, latents, lambda_q, first.views, second)
    header = header_of(profile, scene, (first, second))
    gaussians = emission.emit(profile.receiver, third.after, views.cameras, header, None, MAX_SH_DEGREE)
    return len(third.payload), gaussians


def _missing(
    profile: Profile, scene: PreparedScene, matched: MatchedViews, before: CodedStage, lambda_q: int
) -> Latents:
    """Latents of what the rendering after a stage lacks."""
    rendering = stage_rendering(profile, scene, before.after)
    return analyse(
        profile, feedback_features(profile, scene, matched.depth, rendering, lambda_q), before.state, lambda_q, 2
    )


def row(name: str, found: Measured, reference: Measured) -> str:
    """The variant's means, then its differences to the reference with their standard errors."""
    columns = list(zip(*map(astuple, found.entries), strict=True))
    others = list(zip(*map(astuple, reference.entries), strict=True))
    cells = [name, *(f"{mean(column):.3f}" for column in columns)]
    cells.append(f"{100 * (mean(columns[0]) / mean(others[0]) - 1):+.1f}%")
    cells += [_difference(column, other) for column, other in zip(columns[1:], others[1:], strict=True)]
    if found.batches == reference.batches:  # else there is nothing to compare scene by scene
        relative = 100 / mean(reference.losses)
        cells.append(_difference([relative * x for x in found.losses], [relative * x for x in reference.losses]) + "%")
    else:
        cells.append("-")
    return "\t".join(cells)


def _difference(values: Sequence[float], others: Sequence[float]) -> str:
    differences = [a - b for a, b in zip(values, others, strict=True)]
    return f"{mean(differences):+.3f}±{stdev(differences) / math.sqrt(len(differences)):.3f}"
