"""The stress suite: code every case with the codec and with JPEG XL at equal bytes, and check the rule of the case."""

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fecocodec.captures.evaluation_index import read_index
from fecocodec.container import quantise_lambda
from fecocodec.errors import FecoError, InputError
from fecocodec.evaluation.evaluation import choose_entries
from fecocodec.evaluation.novel_views import open_scenes, render_views
from fecocodec.evaluation.stress.cases import (
    CASE_SIZE,
    Coded,
    Rule,
    StressCase,
    Trial,
    cases_of,
    format_cases_of,
    room_cases,
)
from fecocodec.evaluation.systems.image_compression import reconstruct_at
from fecocodec.geometry.bundle_adjustment import adjusted_with_checks
from fecocodec.geometry.depth_range import believable_bounds
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.sparse_matches import corners_of
from fecocodec.limits import require_depths
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import Codec
from fecocodec.sender.decoded_quality import decoded_quality, left_out_quality
from fecocodec.sender.encode import encode_with
from fecocodec.sender.exposure import exposure_factors, with_factors
from fecocodec.sender.input_warnings import check_input
from fecocodec.sender.view_quality import left_out_warnings, quality_warnings
from fecocodec.splat_files.ply import write_ply

STRESS_LAMBDA = 1e-3
GENERATIONS = 5
RULE_OF_GENERATIONS = Rule(most_lost=4.0)


@dataclass(frozen=True)
class Verdict:
    """Result of one case. psnr: of the target views, in dB. lost: PSNR loss compared with the reference, in dB.

    kib: file size. ahead: PSNR above that of the baseline, whose photographs have `baseline_kib`, in dB. These are None
    if encoding failed. warnings: number of the sender's warnings. complaint: how the rule is violated, empty if it is
    satisfied.
    """

    case: str
    rule: str
    psnr: float | None = None
    lost: float | None = None
    kib: float | None = None
    ahead: float | None = None
    baseline_kib: float | None = None
    warnings: int = 0
    complaint: str = ""

    @property
    def is_passed(self) -> bool:
        """Whether the rule is satisfied."""
        return not self.complaint


class StressSuite:
    """Runs stress cases one by one. Results of the reference of each scene are cached."""

    def __init__(self, codec: Codec, lmbda: float = STRESS_LAMBDA) -> None:
        self._codec = codec
        self._lambda_q = quantise_lambda(lmbda)
        self._reference: dict[str, Coded] = {}  # by scene

    def judge(self, case: StressCase) -> Verdict:
        """Run a case and check its rule. Every error is a failure, except an InputError where it must be refused."""
        reference, trial = self._reference_of(case), case.trial()
        try:
            trial = _as_read(trial)
            found, gaussians = self._run(trial)
        except (FecoError, RuntimeError, ArithmeticError, ValueError) as error:
            was_refused = case.rule.is_refused and isinstance(error, InputError)
            complaint = "" if was_refused else f"{type(error).__name__}: {error}"
            return Verdict(case.name, str(case.rule), complaint=complaint)
        baseline = reconstruct_at(self._codec, len(found.data), trial.views, trial.num_context)
        ahead = found.psnr - _psnr_of_targets(baseline.images, trial)
        verdict = _verdict(case.name, case.rule, found, gaussians, reference, ahead)
        return replace(verdict, baseline_kib=baseline.num_bytes / 1024)

    def judge_generations(self, name: str, trial: Trial) -> Verdict:
        """Encode and decode a scene GENERATIONS times, each time from the renderings of the previous generation.

        Quality is measured against the original photographs.
        """
        views, context = trial.views, list(range(trial.num_context))
        found, gaussians = self._run(trial)
        first = found
        for _ in range(GENERATIONS - 1):
            renderings = render_views(gaussians, views)[context]
            rendered = replace(views, images=torch.cat((renderings, views.images[len(context) :])))
            found, gaussians = self._run(Trial(rendered, trial.num_context))
        return _verdict(self.name_of_generations(name), RULE_OF_GENERATIONS, found, gaussians, first)

    @staticmethod
    def name_of_generations(name: str) -> str:
        """Return the case name of repeated coding of this scene."""
        return f"{name}: {GENERATIONS} generations"

    def _reference_of(self, case: StressCase) -> Coded:
        scene = case.name.partition(":")[0]
        if scene not in self._reference:
            self._reference[scene], _ = self._run(_as_read(case.reference()))
        return self._reference[scene]

    def _run(self, trial: Trial) -> tuple[Coded, Gaussians]:
        """Encode and decode the context views, and measure PSNR at the target views of the trial."""
        context, receiver = trial.views.select(list(range(trial.num_context))), self._codec.receiver
        warnings = list(check_input(context))
        data = encode_with(self._codec, context, self._lambda_q, on_warning=warnings.append)
        gaussians = decode_with(receiver, data).gaussians
        if poor := quality_warnings(decoded_quality(receiver, data, context), context.names):
            warnings += poor
        elif left_out := left_out_quality(receiver, data, context):
            warnings += left_out_warnings(left_out, context.names)
        return Coded(data, _psnr_of_targets(render_views(gaussians, trial.views), trial), tuple(warnings)), gaussians


def _verdict(
    case: str, rule: Rule, found: Coded, gaussians: Gaussians, reference: Coded, ahead: float | None = None
) -> Verdict:
    return Verdict(
        case,
        str(rule),
        psnr=found.psnr,
        lost=reference.psnr - found.psnr,
        kib=len(found.data) / 1024,
        ahead=ahead,
        warnings=len(found.warnings),
        complaint=_not_finite(found, gaussians) or rule.complaint(found, reference, ahead),
    )


def _as_read(trial: Trial) -> Trial:
    """Return the trial with the cameras, bounds of depth and exposure that `encode` gives to photographs of a folder.

    Cameras of targets are adjusted to the coded ones, as `encode` does for checks; exposures of targets stay.
    """
    views, coded = trial.views, list(range(trial.num_context))
    require_depths(float(views.cameras.near), float(views.cameras.far))
    corners = corners_of(views.images, views.ignored)
    num_targets = len(views.images) - trial.num_context
    cameras, _ = adjusted_with_checks(views.cameras, corners, num_targets, views.select(coded))
    views = replace(views, cameras=cameras)
    if (factors := exposure_factors([views.select(coded)], corners[: trial.num_context])) is not None:
        views = with_factors(views, torch.cat((*factors, torch.ones(num_targets, 3))))
    if bounds := believable_bounds(views.select(coded)):
        views = views.within(*bounds)
    return replace(trial, views=views)


def _psnr_of_targets(images: torch.Tensor, trial: Trial) -> float:
    return float(psnr(images[trial.num_context :], trial.views.images[trial.num_context :]).mean())


def _not_finite(found: Coded, gaussians: Gaussians) -> str:
    """Return which value is not finite, or an empty string."""
    if not all(bool(field.isfinite().all()) for field in gaussians.fields()):
        return "a Gaussian is not finite"
    if not math.isfinite(found.psnr):
        return "a rendered image is not finite"
    with tempfile.TemporaryDirectory() as folder:
        try:
            write_ply(Path(folder, "scene.ply"), gaussians)
        except FecoError as error:
            return f"the PLY cannot be written: {error}"
    return ""


def read_pairs(root: Path, index: Path, most: int) -> dict[str, Trial]:
    """Read at most `most` two-view entries, evenly spread. Raises InputError for none, or an unreadable scene."""
    read = open_scenes(root, CASE_SIZE)
    entries = choose_entries(read_index(index), 2, most, index)
    return {entry.name: Trial(read(entry), 2) for entry in entries}


def run_suite(
    codec: Codec, pairs: Mapping[str, Trial], lmbda: float, known: Mapping[str, Verdict] | None = None
) -> Iterator[tuple[Verdict, float]]:
    """Yield each verdict with the completed fraction: cases of every pair, of the room, and repeated coding of a pair.

    Sizes, units and repeated coding, whose effect hardly depends on the scene, are of the first pair. known: verdicts
    of an earlier run by case, which are reused.
    """
    suite, known, first = StressSuite(codec, lmbda), known or {}, dict(list(pairs.items())[:1])
    cases = [case for name, pair in pairs.items() for case in cases_of(pair, name)]
    cases += [case for name, pair in first.items() for case in format_cases_of(pair, name)] + list(room_cases())
    total = len(cases) + len(first)
    for number, case in enumerate(cases, start=1):
        yield known.get(case.name) or suite.judge(case), number / total
    for number, (name, pair) in enumerate(first.items(), start=len(cases) + 1):
        yield known.get(suite.name_of_generations(name)) or suite.judge_generations(name, pair), number / total
