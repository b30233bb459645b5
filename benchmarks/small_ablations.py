"""Train a small version of each of the paper's ablations, measure it, and draw the paper's three panels.

python benchmarks/small_ablations.py PHOTOGRAPHS SCENES INDEX.json WORK [--steps 600] [--chart ablations.png]

A variant is the configuration `ablate-*` (docs/paper_profile.md) with the compact extractor in place of the paper's.
All variants start from the shipped weights. Layers whose shape the shipped weights do not have start anew; in the panel
of Gaussian resolutions that is the output layer of P, in all three variants. The extractor is frozen. The scenes of
PHOTOGRAPHS that all variants train on are drawn once and kept in memory with their features, and every variant takes
the same scenes in the same order, with the same lambda. SCENES and INDEX.json are those of `fecosplat eval`. A model of
two stages at most is measured by its files. Streams cannot hold three stages: their rate is the size of the payloads.

WORK receives the checkpoint, weights and measurements of each variant. Run the same command again to go on after an
interruption; use another folder for other settings.
"""

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fecocodec.checkpoint import DEFAULT_MODEL, SENDER_FILE, SHIPPED
from fecocodec.config import PAPER, ReceiverConfig, SenderConfig
from fecocodec.errors import FecoError
from fecocodec.evaluation.evaluation import Plan, evaluate_to_folder
from fecocodec.evaluation.report.section import Chart, Mark, Series, number, table, write_panels
from fecocodec.evaluation.summary import Average
from fecocodec.training.batch import BatchShapes
from fecocodec.training.batch_source import KeptBatches
from fecocodec.training.configurations import Configuration, RunSettings, configuration_named
from fecocodec.training.loop import train
from fecocodec.training.model_weights import export_model
from fecocodec.training.sources import Sources, draw_batch, open_sources
from fecocodec.training.trainer import Trainer
from fecocodec.training.training_pass import extract

WARM_UP = 20  # steps
SEED = 0


@dataclass(frozen=True)
class Panel:
    """Variants that are compared: their names in the chart and their configurations. anew: layers that start anew."""

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
        {part: f"ablate-gaussians-{part}" for part in ("quarter", "half", "full")},
        anew=("receiver.predictor.head.2",),  # the output layer of P
    ),
    Panel("Iterations", {f"{count}": f"ablate-iterations-{count}" for count in (1, 2, 3)}),
)


def main() -> None:
    arguments = parse_arguments()
    torch.set_num_threads(arguments.threads)
    train_all(arguments, [(name, panel.anew) for panel in PANELS for name in panel.variants.values()])
    rows = {name: measure(arguments.work / name, arguments) for panel in PANELS for name in panel.variants.values()}
    print(table_of(rows))
    write_panels([chart_of(panel, rows) for panel in PANELS], arguments.chart or arguments.work / "ablations_small.png")


def train_all(arguments: argparse.Namespace, variants: Sequence[tuple[str, tuple[str, ...]]]) -> None:
    """Train the variants (name of the configuration, layers that start anew) that are not exported yet."""
    kept: KeptBatches | None = None
    sources: Sources | None = None
    for name, anew in variants:
        folder, configuration = arguments.work / name, small_version(name, arguments)
        if (folder / "model" / SENDER_FILE).exists():
            continue
        sources = sources or open_sources(arguments.photographs, None, configuration)
        trainer = Trainer(settings_of(folder, configuration), sources)
        started = trainer.start_variant_from(SHIPPED / DEFAULT_MODEL, anew)
        kept = kept or draw_scenes(trainer)
        train_variant(trainer, kept, started)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path, help="folder of posed scenes to train on")
    parser.add_argument("scenes", type=Path, help="folder of other scenes, to measure")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("work", type=Path, help="folder for checkpoints, weights and measurements")
    parser.add_argument("--chart", type=Path, help="the chart, PNG  [default: WORK/ablations_small.png]")
    parser.add_argument("--steps", type=int, default=600, help="steps of each variant  [default: 600]")
    parser.add_argument("--batch", type=int, default=1, help="scenes in a step  [default: 1]")
    parser.add_argument("--keep", type=int, default=100, help="batches that are drawn and kept  [default: 100]")
    parser.add_argument("--targets", type=int, default=2, help="target views of a scene  [default: 2]")
    parser.add_argument("--side", type=int, default=128, help="image side in pixels  [default: 128]")
    parser.add_argument("--measured-side", type=int, default=128, help="image side when measuring  [default: 128]")
    parser.add_argument("--learning-rate", type=float, default=4e-4, help="largest learning rate  [default: 4e-4]")
    parser.add_argument("--lambdas", type=float, nargs="+", default=[1e-2, 1e-3, 1e-4], help="values to measure")
    parser.add_argument("--most", type=int, help="measure at most so many entries of the index")
    parser.add_argument("--threads", type=int, default=1, help="threads of torch  [default: 1]")
    return parser.parse_args()


def small_version(name: str, arguments: argparse.Namespace) -> Configuration:
    """Return a configuration of the paper with the compact extractor, frozen, and small batches."""
    paper, size = configuration_named(name), (arguments.side, arguments.side)
    return replace(
        paper,
        shapes=BatchShapes(arguments.batch, ((2, 1.0),), arguments.targets, (size,)),
        schedule=replace(
            paper.schedule, num_steps=arguments.steps, learning_rate=arguments.learning_rate, warm_up=WARM_UP
        ),
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


def settings_of(folder: Path, configuration: Configuration) -> RunSettings:
    return RunSettings(folder / "run", configuration, None, SEED, log_every=25, samples_every_minutes=math.inf)


def draw_scenes(trainer: Trainer) -> KeptBatches:
    """Draw the batches that all variants train on, with their features."""
    configuration, generator = trainer.settings.configuration, torch.Generator().manual_seed(SEED)
    kept = KeptBatches(configuration.kept_batches, configuration.lambda_q_range, fresh_share=0.0)
    shape = configuration.shapes.usual
    for _ in range(kept.limit):
        batch = draw_batch(trainer.sources, generator, shape, 1.0)
        kept.add(shape, batch, extract(trainer.sender, trainer.receiver, True, batch))
    return kept


def train_variant(trainer: Trainer, kept: KeptBatches, anew: tuple[str, ...]) -> None:
    """Train a variant to its last step and export it. anew: tensors that start anew, to be printed."""
    trainer.take_batches_from(kept)
    folder = trainer.settings.folder.parent
    if trainer.checkpoint.exists():
        trainer.resume(trainer.checkpoint)
    print(f"{folder.name}: from step {trainer.step}; new: {', '.join(anew)}", flush=True)
    for row in train(trainer):
        print("  ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
    export_model(trainer.checkpoint, folder / "model", trainer.settings.configuration)


def measure(folder: Path, arguments: argparse.Namespace) -> tuple[Average, ...]:
    """Measure a variant, or read its measurements, and return one row per lambda: those with all stages."""
    size = (arguments.measured_side, arguments.measured_side)
    plan = Plan(
        arguments.scenes, arguments.index, folder / "model", folder / "eval", ("codec",),
        tuple(arguments.lambdas), size, num_context=2, most=arguments.most, with_strips=False,
    )  # fmt: skip
    report = evaluate_to_folder(plan)
    if report.failures:
        raise FecoError(f"{folder}: {len(report.failures)} measurements failed: {report.failures[0].error}")
    last = report.averages[-1].system  # of three stages, the estimate follows the files of two
    return tuple(row for row in report.averages if row.system == last)


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
