"""Train a small version of each of the paper's ablations, measure it, and draw the paper's three panels.

python benchmarks/small_ablations.py PHOTOGRAPHS SCENES INDEX.json WORK [--seeds 0 1] [--steps 2000]
    [--panels Components] [--chart ablations.png]

A variant is the configuration `ablate-*` (docs/paper_profile.md) with the compact extractor in place of the paper's.
All variants of a seed start from one model, trained from the shipped weights for `--start-steps` in each of which
context and feedback are left out with probability 1/2, so that the start favours no variant. Layers whose shape the
shipped weights do not have start anew; in the panel of Gaussian resolutions that is the output layer of P, in all three
variants. The extractor is frozen. The scenes of PHOTOGRAPHS that all variants train on are drawn once a seed and kept
in memory with their features; all take the same scenes in the same order, with the same lambda. SCENES and INDEX.json
are those of `fecosplat eval`. A model of two stages at most is measured by its files. Streams cannot hold three stages:
their rate is the size of the payloads.

WORK receives the checkpoint, weights and measurements of each variant. Run the same command again to go on after an
interruption, or to join seeds that were trained apart; use another folder for other settings.
"""

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SENDER_FILE, SHIPPED
from fecocodec.config import NO_CONTEXT, NO_FEEDBACK, PAPER, ReceiverConfig, SenderConfig
from fecocodec.errors import FecoError
from fecocodec.evaluation.evaluation import RECORDS, Plan, evaluate_to_folder
from fecocodec.evaluation.records import Measurement, RecordFile
from fecocodec.evaluation.report.section import Chart, Mark, Series, number, table, write_panels
from fecocodec.evaluation.summary import Average, averages
from fecocodec.receiver.model import load_receiver
from fecocodec.sender.codec import load_sender
from fecocodec.training.batch import BatchShapes
from fecocodec.training.batch_source import KeptBatches
from fecocodec.training.configurations import Configuration, RunSettings, configuration_named
from fecocodec.training.loop import train
from fecocodec.training.model_weights import export_model
from fecocodec.training.sources import Sources, draw_batch, open_sources
from fecocodec.training.trainer import Trainer
from fecocodec.training.training_pass import extract

WARM_UP = 20  # steps
START = "start"  # folder of the model from which all variants of a seed start
NUM_RESAMPLES = 10_000

Found = Mapping[str, Sequence[Measurement]]
"""Measurements of all seeds by variant, in the same order of seeds, entries and lambdas."""


@dataclass(frozen=True)
class Panel:
    """Variants that are compared with the first (name in the chart: configuration). anew: layers that start anew."""

    title: str
    variants: Mapping[str, str]
    anew: tuple[str, ...] = ()


PANELS = (
    Panel(
        "Components",
        {"full": "ablate-iterations-2", "no context": "ablate-no-context", "no feedback": "ablate-no-feedback"},
    ),
    Panel(
        "Gaussian resolution",
        {part: f"ablate-gaussians-{part}" for part in ("half", "quarter", "full")},
        anew=("receiver.predictor.head.2",),  # the output layer of P
    ),
    Panel("Iterations", {f"{count}": f"ablate-iterations-{count}" for count in (2, 1, 3)}),
)


def main() -> None:
    arguments = parse_arguments()
    torch.set_num_threads(arguments.threads)
    panels = [panel for panel in PANELS if panel.title in arguments.panels]
    found: dict[str, list[Measurement]] = {}
    for seed in arguments.seeds:
        train_all(arguments, seed, {name: panel.anew for panel in panels for name in panel.variants.values()})
        for name in {name: None for panel in panels for name in panel.variants.values()}:
            of_seed = measure(folder_of(arguments, seed) / name, arguments)
            found.setdefault(name, []).extend(replace(m, entry=f"{m.entry}, seed {seed}") for m in of_seed)
    rows = {name: averages(measurements) for name, measurements in found.items()}
    print(table_of(rows))
    print(differences_of(panels, found, len(arguments.seeds)))
    write_panels([chart_of(panel, rows) for panel in panels], arguments.chart or arguments.work / "ablations_small.png")


def folder_of(arguments: argparse.Namespace, seed: int) -> Path:
    folder: Path = arguments.work / f"seed_{seed}"
    return folder


def train_all(arguments: argparse.Namespace, seed: int, variants: Mapping[str, tuple[str, ...]]) -> None:
    """Train the start and the variants (name of the configuration: layers that start anew) that are not exported."""
    kept: KeptBatches | None = None
    sources: Sources | None = None
    start = folder_of(arguments, seed) / START
    for name, anew in {START: (), **variants}.items():
        folder = folder_of(arguments, seed) / name
        if (folder / "model" / SENDER_FILE).exists():
            continue
        is_start = name == START
        of = ("ablate-iterations-2", arguments.start_steps) if is_start else (name, arguments.steps)
        configuration = small_version(*of, arguments)
        sources = sources or open_sources(arguments.photographs, None, configuration)
        trainer = (TrainerOfStart if is_start else Trainer)(settings_of(folder, configuration, seed), sources)
        started = start_variant_from(trainer, SHIPPED / DEFAULT_MODEL if is_start else start / "model", anew)
        kept = kept or draw_scenes(trainer, seed)
        train_variant(trainer, kept, started)


def start_variant_from(trainer: Trainer, model: Path, anew: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Copy the weights of a model's folder that have the same name and shape.

    anew: layers that are not copied, such as "receiver.predictor.head.2". Returns the names of the tensors that keep
    their initial values. Raises ModelError if the model is missing or damaged.
    """
    released, model_id = load_receiver(model / RECEIVER_FILE)
    trained = load_sender(model / SENDER_FILE, released.config, model_id)
    tensors = trainer.networks.state_dict()
    known = nn.ModuleDict({"receiver": released, "sender": trained}).state_dict()
    fitting = {
        name: value
        for name, value in known.items()
        if name in tensors and value.shape == tensors[name].shape and not name.startswith(tuple(f"{a}." for a in anew))
    }
    trainer.networks.load_state_dict(tensors | fitting)
    trainer.begin_average()
    return tuple(name for name in tensors if name not in fitting)


class TrainerOfStart(Trainer):
    """Leaves out context and feedback, each in half of the steps."""

    def train_step(self) -> dict[str, float]:
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + self.step)
        parts = [part for part in (NO_CONTEXT, NO_FEEDBACK) if float(torch.rand((), generator=generator)) < 0.5]
        self.sender.config = replace(self.sender.config, ablation=" ".join(parts))
        return super().train_step()


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path, help="folder of posed scenes to train on")
    parser.add_argument("scenes", type=Path, help="folder of other scenes, to measure")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("work", type=Path, help="folder for checkpoints, weights and measurements")
    parser.add_argument("--chart", type=Path, help="the chart, PNG  [default: WORK/ablations_small.png]")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1], help="each trains all of it  [default: 0 1]")
    parser.add_argument("--panels", nargs="+", default=[panel.title for panel in PANELS], help="  [default: all]")
    parser.add_argument("--start-steps", type=int, default=1000, help="steps of the start  [default: 1000]")
    parser.add_argument("--steps", type=int, default=2000, help="steps of each variant  [default: 2000]")
    parser.add_argument("--batch", type=int, default=1, help="scenes in a step  [default: 1]")
    parser.add_argument("--keep", type=int, default=120, help="batches that are drawn and kept  [default: 120]")
    parser.add_argument("--targets", type=int, default=1, help="target views of a scene  [default: 1]")
    parser.add_argument("--side", type=int, default=96, help="image side in pixels  [default: 96]")
    parser.add_argument("--measured-side", type=int, default=128, help="image side when measuring  [default: 128]")
    parser.add_argument("--learning-rate", type=float, default=4e-4, help="largest learning rate  [default: 4e-4]")
    parser.add_argument("--lambdas", type=float, nargs="+", default=[1e-2, 1e-3, 1e-4], help="values to measure")
    parser.add_argument("--most", type=int, help="measure at most so many entries of the index")
    parser.add_argument("--threads", type=int, default=1, help="threads of torch  [default: 1]")
    return parser.parse_args()


def small_version(name: str, num_steps: int, arguments: argparse.Namespace) -> Configuration:
    """Return a configuration of the paper with the compact extractor, frozen, and small batches."""
    paper, size = configuration_named(name), (arguments.side, arguments.side)
    return replace(
        paper,
        shapes=BatchShapes(arguments.batch, ((2, 1.0),), arguments.targets, (size,)),
        schedule=replace(paper.schedule, num_steps=num_steps, learning_rate=arguments.learning_rate, warm_up=WARM_UP),
        precision="float32",
        receiver=ReceiverConfig(
            method=PAPER,
            gaussians_per_side=paper.receiver.gaussians_per_side,
            num_stages=paper.receiver.num_stages,
            codes_stages_apart=paper.receiver.codes_stages_apart,
        ),  # with the widths of the model from which the variants start
        sender=SenderConfig(ablation=paper.sender.ablation),
        frozen=("extractor",),
        kept_batches=arguments.keep,
        protocol=None,
    )


def settings_of(folder: Path, configuration: Configuration, seed: int) -> RunSettings:
    return RunSettings(folder / "run", configuration, None, seed, log_every=25, samples_every_minutes=math.inf)


def draw_scenes(trainer: Trainer, seed: int) -> KeptBatches:
    """Draw the batches that all variants train on, with their features."""
    configuration, generator = trainer.settings.configuration, torch.Generator().manual_seed(seed)
    kept = KeptBatches(configuration.kept_batches, configuration.lambda_q_range, fresh_share=0.0)
    shape = configuration.shapes.usual
    for _ in range(kept.limit):
        batch = draw_batch(trainer.sources, generator, shape, 1.0)
        kept.add(shape, batch, extract(trainer.sender, trainer.receiver, True, batch))
    return kept


def train_variant(trainer: Trainer, kept: KeptBatches, anew: tuple[str, ...]) -> None:
    """Train a variant to its last step and export it. anew: tensors that start anew, to be printed."""
    trainer.batches.kept = kept
    folder = trainer.settings.folder.parent
    if trainer.checkpoint.exists():
        trainer.resume(trainer.checkpoint)
    print(f"{folder.name}: from step {trainer.step}; new: {', '.join(anew)}", flush=True)
    for row in train(trainer):
        print("  ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
    export_model(trainer.checkpoint, folder / "model", trainer.settings.configuration)


def measure(folder: Path, arguments: argparse.Namespace) -> Sequence[Measurement]:
    """Measure a variant, or read its measurements: those with all stages."""
    size = (arguments.measured_side, arguments.measured_side)
    plan = Plan(
        arguments.scenes, arguments.index, folder / "model", folder / "eval", ("codec",),
        tuple(arguments.lambdas), size, num_context=2, most=arguments.most, with_strips=False,
    )  # fmt: skip
    report = evaluate_to_folder(plan)
    if report.failures:
        raise FecoError(f"{folder}: {len(report.failures)} measurements failed: {report.failures[0].error}")
    last = report.averages[-1].system  # of three stages, the estimate follows the files of two
    found = RecordFile(folder / "eval" / RECORDS).select(lambda m: m.system == last)
    return sorted(found, key=lambda m: (m.entry, m.setting))


def differences_of(panels: Sequence[Panel], found: Found, num_seeds: int) -> str:
    """Return a table of what each variant changes against the first of its panel, at equal lambda.

    Means over seeds, entries and lambdas of bits (geometric mean, in percent) and of the PSNR of target and of context
    views, in dB, with 95% intervals by bootstrap over scenes; in brackets the mean of each seed.
    """
    lines = []
    for panel in panels:
        first, *others = panel.variants.values()
        for name in others:
            pairs = list(zip(found[first], found[name], strict=True))
            scenes = [a.entry.split("/")[0] for a, _ in pairs]
            bits = np.array([math.log(b.bits_per_pixel / a.bits_per_pixel) for a, b in pairs])
            target, context = (
                np.array([getattr(b, field) - getattr(a, field) for a, b in pairs])
                for field in ("psnr", "context_psnr")
            )
            of_views = (interval(values, scenes, num_seeds) for values in (target, context))
            lines.append((name, first, interval(bits, scenes, num_seeds, in_percent), *of_views))
    return table(("variant", "against", "bits, percent", "target views, dB", "context views, dB"), lines)


def in_percent(log_ratio: float) -> str:
    return f"{100.0 * math.expm1(log_ratio):+.1f}"


def in_db(value: float) -> str:
    return f"{value:+.2f}"


def interval(values: np.ndarray, scenes: Sequence[str], num_seeds: int, shown: Callable[[float], str] = in_db) -> str:
    """Return the mean, its interval over scenes and the means of the seeds, which follow each other in `values`."""
    names = sorted(set(scenes))
    of_scene = [values[[scene == name for scene in scenes]] for name in names]
    drawn = np.random.default_rng(0).integers(0, len(names), (NUM_RESAMPLES, len(names)))
    sums, counts = np.array([v.sum() for v in of_scene]), np.array([len(v) for v in of_scene])
    low, high = np.percentile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), (2.5, 97.5))
    of_seeds = ", ".join(shown(part.mean()) for part in np.split(values, num_seeds))
    return f"{shown(values.mean())} [{shown(low)}, {shown(high)}] ({of_seeds})"


def chart_of(panel: Panel, rows: Mapping[str, tuple[Average, ...]]) -> Chart:
    series = tuple(
        Series(label, tuple(Mark(row.bits_per_pixel, row.psnr, row.setting) for row in rows[name]))
        for label, name in panel.variants.items()
    )
    return Chart("ablation", panel.title, "bits per context pixel", "PSNR of target views, dB", series, has_log_x=True)


def table_of(rows: Mapping[str, tuple[Average, ...]]) -> str:
    """Return a table of all variants: bits per context pixel, PSNR of target and of context views at each lambda."""
    settings = [row.setting for row in next(iter(rows.values()))]
    lines = [
        (name, *(" / ".join((number(r.bits_per_pixel, 3), number(r.psnr), number(r.context_psnr))) for r in found))
        for name, found in rows.items()
    ]
    return table(("configuration", *settings), lines)


if __name__ == "__main__":
    main()
