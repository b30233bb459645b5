"""The stress suite: code every case with the codec and with a baseline, and check the rule of the case."""

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fecocodec.captures.evaluation_index import read_index
from fecocodec.container import quantise_lambda, read_stream
from fecocodec.errors import FecoError, InputError
from fecocodec.evaluation.entries import open_scenes
from fecocodec.evaluation.evaluation import choose_entries
from fecocodec.evaluation.novel_views import render_views
from fecocodec.evaluation.stress.cases import StressCase, Trial, cases_of, room_cases
from fecocodec.evaluation.systems.image_compression import image_systems
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.input_warnings import check_input
from fecocodec.splat_files.ply import write_ply

STRESS_LAMBDA = 1e-3
BASELINE = ("JPEG XL", "quality 4")
GENERATIONS = 10
LARGEST_GENERATION_LOSS_DB = 6.0
SAME_PICTURE_DB, SAME_QUALITY_DB = 0.05, 0.5


@dataclass(frozen=True)
class Verdict:
    """Result of one case. psnr: of the target views, in dB. lost: PSNR loss compared with the reference, in dB.

    baseline_psnr, baseline_lost: the same for the baseline. kib: file size. These are None if encoding failed.
    warnings: number of input warnings. complaint: how the rule is violated, empty if it is satisfied.
    """

    case: str
    rule: str
    psnr: float | None
    lost: float | None
    baseline_psnr: float | None
    baseline_lost: float | None
    kib: float | None
    warnings: int
    complaint: str

    @property
    def is_passed(self) -> bool:
        """Whether the rule is satisfied."""
        return not self.complaint


@dataclass(frozen=True)
class _Outcome:
    data: bytes
    gaussians: Gaussians
    psnr: float


class StressSuite:
    """Runs stress cases one by one. Results of the reference of each scene are cached."""

    def __init__(self, codec: Codec, lmbda: float = STRESS_LAMBDA) -> None:
        self._codec = codec
        self._lambda_q = quantise_lambda(lmbda)
        (self._baseline,) = (s for s in image_systems(codec) if (s.name, s.setting) == BASELINE)
        self._reference: dict[str, tuple[_Outcome, float]] = {}  # by scene: outcome of the codec, PSNR of the baseline

    def judge(self, case: StressCase) -> Verdict:
        """Run a case and check its rule. Every error is a failure, except an InputError if the rule is "refused"."""
        reference, reference_baseline = self._outcome_of_reference(case)
        trial = case.trial()
        warnings = check_input(trial.views.select(list(range(trial.num_context))))
        try:
            found = self._run(trial)
        except (FecoError, RuntimeError, ArithmeticError, ValueError) as error:
            was_refused = case.rule == "refused" and isinstance(error, InputError)
            return _verdict(case, warnings, "" if was_refused else f"{type(error).__name__}: {error}")
        baseline = self._run_baseline(trial)
        return Verdict(
            case=case.name,
            rule=case.rule,
            psnr=found.psnr,
            lost=reference.psnr - found.psnr,
            baseline_psnr=baseline,
            baseline_lost=reference_baseline - baseline,
            kib=len(found.data) / 1024,
            warnings=len(warnings),
            complaint=_complaint(case.rule, found, reference, warnings),
        )

    def judge_generations(self, name: str, trial: Trial) -> Verdict:
        """Encode and decode a scene GENERATIONS times, each time from the renderings of the previous generation.

        Quality is measured against the original photographs.
        """
        views, context = trial.views, list(range(trial.num_context))
        first = found = self._run(trial)
        for _ in range(GENERATIONS - 1):
            renderings = render_views(found.gaussians, views)[context]
            rendered = replace(views, images=torch.cat((renderings, views.images[len(context) :])))
            found = self._run(Trial(rendered, trial.num_context))
        lost = first.psnr - found.psnr
        complaint = _not_finite(found) or (
            f"{lost:.2f} dB lost in {GENERATIONS} generations" if lost > LARGEST_GENERATION_LOSS_DB else ""
        )
        return Verdict(
            self.name_of_generations(name),
            "bounded",
            found.psnr,
            lost,
            None,
            None,
            len(found.data) / 1024,
            0,
            complaint,
        )

    @staticmethod
    def name_of_generations(name: str) -> str:
        """Return the case name of repeated coding of this scene."""
        return f"{name}: {GENERATIONS} generations"

    def _outcome_of_reference(self, case: StressCase) -> tuple[_Outcome, float]:
        scene = case.name.partition(":")[0]
        if scene not in self._reference:
            trial = case.reference()
            self._reference[scene] = self._run(trial), self._run_baseline(trial)
        return self._reference[scene]

    def _run(self, trial: Trial) -> _Outcome:
        """Encode and decode the context views, and measure PSNR at the target views of the trial."""
        data = encode_with(self._codec, trial.views.select(list(range(trial.num_context))), self._lambda_q)
        gaussians = decode_with(self._codec.receiver, data).gaussians
        rendered = render_views(gaussians, trial.views)[trial.num_context :]
        return _Outcome(data, gaussians, float(psnr(rendered, trial.views.images[trial.num_context :]).mean()))

    def _run_baseline(self, trial: Trial) -> float:
        images = self._baseline.reconstruct(trial.views, trial.num_context).images
        return float(psnr(images[trial.num_context :], trial.views.images[trial.num_context :]).mean())


def _verdict(case: StressCase, warnings: tuple[str, ...], complaint: str) -> Verdict:
    return Verdict(case.name, case.rule, None, None, None, None, None, len(warnings), complaint)


def _complaint(rule: str, found: _Outcome, reference: _Outcome, warnings: tuple[str, ...]) -> str:
    """Return how the rule is violated, or an empty string."""
    if problem := _not_finite(found):
        return problem
    difference = abs(found.psnr - reference.psnr)
    if rule == "refused":
        return "it was not refused"
    if rule == "warned" and not warnings:
        return "the sender gave no warning"
    if rule == "same bytes" and read_stream(found.data).payloads != read_stream(reference.data).payloads:
        return "the payloads differ from those of the reference"
    if rule in ("same bytes", "same picture") and difference > SAME_PICTURE_DB:
        return f"the PSNR differs by {difference:.3f} dB from that of the reference"
    if rule == "same quality" and difference > SAME_QUALITY_DB:
        return f"the PSNR differs by {difference:.2f} dB from that of the reference"
    return ""


def _not_finite(found: _Outcome) -> str:
    """Return which value is not finite, or an empty string."""
    if not all(bool(field.isfinite().all()) for field in found.gaussians.fields()):
        return "a Gaussian is not finite"
    if not math.isfinite(found.psnr):
        return "a rendered image is not finite"
    with tempfile.TemporaryDirectory() as folder:
        try:
            write_ply(Path(folder, "scene.ply"), found.gaussians)
        except FecoError as error:
            return f"the PLY cannot be written: {error}"
    return ""


def read_pairs(root: Path, index: Path, most: int) -> dict[str, Trial]:
    """Read at most `most` two-view entries, evenly spaced over the index, by name.

    Raises InputError if there is no such entry, or if a scene cannot be read.
    """
    read = open_scenes(root)
    entries = choose_entries(read_index(index), 2, most, index)
    return {entry.name: Trial(read(entry), 2) for entry in entries}


def run_suite(
    codec: Codec, pairs: Mapping[str, Trial], lmbda: float, known: Mapping[str, Verdict] | None = None
) -> Iterator[tuple[Verdict, float]]:
    """Yield each verdict with the completed fraction: cases of every pair, of the room, and repeated coding of pairs.

    known: verdicts of an earlier run by case, which are reused.
    """
    suite, known = StressSuite(codec, lmbda), known or {}
    cases = [case for name, pair in pairs.items() for case in cases_of(pair, name)] + list(room_cases())
    total = len(cases) + len(pairs)
    for number, case in enumerate(cases, start=1):
        yield known.get(case.name) or suite.judge(case), number / total
    for number, (name, pair) in enumerate(pairs.items(), start=len(cases) + 1):
        yield known.get(suite.name_of_generations(name)) or suite.judge_generations(name, pair), number / total
