"""`fecosplat train`: train the networks on procedural scenes and on photographs."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fecocodec.errors import InputError

from .options import FILE_PATH, device_option, threads_option
from .output import say, warn
from .paths import require_input, require_output_folder
from .train_options import check_values, configuration_options, overridden

if TYPE_CHECKING:
    from fecocodec.training.configurations import Configuration

DEFAULT_MINUTES = 60.0


@click.command(
    "train",
    short_help="Train the networks.",
    epilog="""\b
Examples:
  fecosplat train runs/first --max-minutes 30
  fecosplat train runs/real --photographs scenes/ --textures textures/ --export weights/mine
  fecosplat train runs/square --views 2 --side 128 --scenes 2
  torchrun --nproc-per-node 4 -m fecosplat_cli train runs/paper --config paper-re10k --photographs re10k/train""",
)
@click.argument("folder", metavar="FOLDER", type=FILE_PATH)
@click.option(
    "--config", "name", default="compact", show_default=True, metavar="NAME",
    help="Training configuration: compact, paper-re10k, paper-dl3dv, or a variant such as "
    "ablate-no-feedback (docs/paper_profile.md). Options below without a default override it.",
)  # fmt: skip
@click.option("--photographs", type=FILE_PATH, help="Folder of posed scenes, each with a transforms.json.")
@click.option(
    "--textures", type=FILE_PATH, help="Folder of images that texture procedural scenes, besides the built-in patterns."
)
@click.option(
    "--validation", type=FILE_PATH, help="Folder of scenes as --photographs, with other scenes, measured now and then."
)
@click.option(
    "--validate-every", type=click.IntRange(min=1), default=5_000, show_default=True, metavar="STEPS",
    help="Steps between two measurements of --validation.",
)  # fmt: skip
@click.option(
    "--keep-every", type=click.IntRange(min=1), default=25_000, show_default=True, metavar="STEPS",
    help="Steps between two checkpoints that are kept, step_*.pt.",
)  # fmt: skip
@click.option(
    "--workers", "num_workers", type=click.IntRange(min=0), default=0, show_default=True,
    help="Number of processes that draw batches ahead, per training process.",
)  # fmt: skip
@click.option(
    "--max-minutes", type=click.FloatRange(min=0, min_open=True),
    help="Save a checkpoint and stop after this time.  [default: 60, no limit for the paper's configurations]",
)  # fmt: skip
@configuration_options
@click.option("--seed", type=click.IntRange(0, 2**31), default=0, show_default=True, help="Seed of random numbers.")
@click.option("--from", "start", type=FILE_PATH, help="Initialise with the weights of the model in this folder.")
@click.option(
    "--extractor-weights", "extractor", type=FILE_PATH,
    help="Initialise the extractor from a model folder, or from a DepthSplat, Depth Anything V2, DINOv2 or UniMatch "
    "file.",
)  # fmt: skip
@click.option(
    "--entropy-steps",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="After the last training step, train the entropy model alone for this many steps, which reduces the rate.",
)
@click.option(
    "--entropy-scenes",
    type=click.IntRange(min=1),
    default=400,
    show_default=True,
    help="Number of scenes per process that --entropy-steps trains on.",
)
@click.option(
    "--step-updates",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="After the entropy model, train the network that proposes steps of latent optimisation alone, for this many "
    "updates.",
)
@click.option(
    "--export", "model", type=FILE_PATH, help="Write the weights and graphs of the finished model to this folder."
)
@device_option
@threads_option
def command(
    folder: Path,
    name: str,
    photographs: Path | None,
    textures: Path | None,
    validation: Path | None,
    validate_every: int,
    keep_every: int,
    num_workers: int,
    max_minutes: float | None,
    seed: int,
    start: Path | None,
    extractor: Path | None,
    entropy_steps: int,
    entropy_scenes: int,
    step_updates: int,
    model: Path | None,
    device: str,
    **overrides: Any,
) -> None:
    """Train the networks. FOLDER receives the checkpoint last.pt, log.csv and samples/; training resumes from its
    checkpoint if there is one.

    Start several processes with torchrun, as in the last example, for data-parallel training.
    """
    _check_paths(folder, (photographs, textures, validation, start, extractor))  # before torch is loaded
    check_values(overrides)

    from fecocodec.rendering.cuda import require_rendering_device
    from fecocodec.training.configurations import configuration_named
    from fecocodec.training.entropy_phase import EntropyPhase, train_entropy_model
    from fecocodec.training.export import export_model
    from fecocodec.training.graphs.export import export_receiver
    from fecocodec.training.log import LOG_COLUMNS
    from fecocodec.training.loop import train
    from fecocodec.training.processes import is_first, joined_processes
    from fecocodec.training.run_settings import RunSettings
    from fecocodec.training.sources import open_sources
    from fecocodec.training.step_phase import StepPhase, train_step_network
    from fecocodec.training.trainer import Trainer

    require_rendering_device(device)
    configuration = overridden(configuration_named(name), overrides)
    _check_options(configuration, entropy_steps, step_updates, num_workers)
    with joined_processes(device) as own_device:
        sources = open_sources(photographs, textures, configuration, validation)
        settings = RunSettings(
            folder, configuration, max_minutes or _default_minutes(configuration), seed, own_device,
            num_workers=num_workers, validate_every=validate_every, keep_every=keep_every,
        )  # fmt: skip
        trainer = Trainer(settings, sources)
        if trainer.checkpoint.exists():
            trainer.resume(trainer.checkpoint)
        elif start is not None:
            trainer.start_from(start)
        if extractor is not None and trainer.step == 0:
            say(f"extractor: {trainer.start_extractor_from(extractor)}")
        for row in train(trainer):
            say("  ".join(f"{name} {row[name]:.4g}" for name in LOG_COLUMNS if name in row))
        last_phases: tuple[tuple[str, int, Callable[[], Iterator[dict[str, float]]]], ...] = (
            (
                "entropy model",
                entropy_steps,
                partial(train_entropy_model, trainer, EntropyPhase(entropy_steps, entropy_scenes)),
            ),
            ("step network", step_updates, partial(train_step_network, trainer, StepPhase(step_updates))),
        )
        for name, num_steps, rows in last_phases:
            if num_steps and trainer.step < configuration.schedule.num_steps:
                if is_first():
                    warn(f"{name}: not trained before the last step of the schedule; run the same command again")
            elif num_steps:
                for row in rows():
                    if is_first():
                        say(f"{name}: " + "  ".join(f"{key} {value:.4g}" for key, value in row.items()))
        if model is not None and is_first():
            _require_finished(trainer.step, configuration.schedule.num_steps, model)
            export_model(trainer.checkpoint, model, configuration, start)
            if not configuration.is_paper:  # torch decodes the paper's method
                export_receiver(model)


def _check_paths(folder: Path, inputs: tuple[Path | None, ...]) -> None:
    """Raise OutputError if the run cannot be written to `folder`, InputError for an input that does not exist."""
    require_output_folder(folder)
    for path in inputs:
        if path is not None:
            require_input(path, "there is no such file or folder; check the path.")


def _check_options(configuration: "Configuration", entropy_steps: int, step_updates: int, num_workers: int) -> None:
    if configuration.sender.extractor == "adapted":
        raise InputError(
            "This configuration needs the network of its extractor; train it in Python (examples/larger_extractor.py)."
        )
    if configuration.is_paper and entropy_steps:
        raise InputError("The paper's method has no phase for the entropy model alone; leave out --entropy-steps.")
    if not configuration.sender.step_channels and step_updates:
        raise InputError("This configuration has no network that proposes steps; leave out --step-updates.")
    if configuration.kept_batches and num_workers:
        raise InputError("Kept batches are drawn by the training process; leave out --workers, or --keep.")


def _default_minutes(configuration: "Configuration") -> float | None:
    return None if configuration.is_paper else DEFAULT_MINUTES


def _require_finished(step: int, num_steps: int, model: Path) -> None:
    if step < num_steps:
        raise InputError(
            f"{model}: nothing was exported, because the run stopped after {step} of {num_steps} steps; "
            f"run the same command again, or export these weights with --steps {step}."
        )
