"""`fecosplat train`: train the networks on procedural scenes and on photographs."""

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.training.batch_limits import check_sizes, check_view_shares

from .options import FILE_PATH, device_option, parse_size, threads_option
from .output import say, warn
from .paths import require_input, require_output_folder

if TYPE_CHECKING:
    from fecocodec.training.configurations import Configuration

DEFAULT_MINUTES = 60.0
_SHAPE_FIELDS = ("num_scenes", "view_shares", "num_target", "sizes")
_SCHEDULE_FIELDS = (
    "num_steps", "one_stage_until", "bypass_until", "learning_rate", "photograph_share", "disparity_weight",
)  # fmt: skip


def _parse_views(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[tuple[int, float], ...] | None:
    """Parse `2` or `2:0.8,4:0.2` to pairs of a number of context views and its probability."""
    if value is None:
        return None
    if not re.fullmatch(r"\d{1,3}(:\d*\.?\d+)?(,\d{1,3}(:\d*\.?\d+)?)*", value):
        raise click.BadParameter(f"{value!r} is neither a number of views nor COUNT:SHARE,COUNT:SHARE...", ctx, param)
    entries = [entry.partition(":") for entry in value.split(",")]
    return tuple((int(count), float(share or 1)) for count, _, share in entries)


def _parse_sizes(ctx: click.Context, param: click.Parameter, values: tuple[str, ...]) -> tuple[Any, ...] | None:
    return tuple(parse_size(ctx, param, value) for value in values) or None


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
    help="Training configuration: compact, paper-re10k, paper-dl3dv, or a variant such as ablate-no-feedback "
    "(docs/paper_profile.md). Options below without a default override it.",
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
@click.option("--steps", "num_steps", type=int, help="Number of training steps.")
@click.option("--one-stage-steps", "one_stage_until", type=int, help="Number of first steps that train stage 1 only.")
@click.option(
    "--bypass-steps", "bypass_until", type=int, help="Number of first steps without rate term and quantisation."
)
@click.option(
    "--scenes",
    "num_scenes",
    type=int,
    help="Batch size: scenes per step and process, for the first --views and --size.",
)
@click.option(
    "--views",
    "view_shares",
    callback=_parse_views,
    help="Number of context views: 2, or probabilities such as 2:0.8,4:0.2.",
)
@click.option("--targets", "num_target", type=int, help="Number of target views per scene.")
@click.option(
    "--size", "sizes", multiple=True, callback=_parse_sizes, metavar="WxH",
    help="Image size in pixels. Repeat the option for several sizes.",
)  # fmt: skip
@click.option("--side", type=int, help="Square image size: --side 128 is --size 128x128. Small sizes need --views 2.")
@click.option("--learning-rate", type=float, help="Peak learning rate.")
@click.option("--lambda-range", type=float, nargs=2, help="Smallest and largest lambda.")
@click.option("--photograph-share", type=float, nargs=2, help="Fraction of photographs, at the first and last step.")
@click.option(
    "--depth-weight", "disparity_weight", type=float, nargs=2, help="Weight of the depth loss, at first and last step."
)
@click.option(
    "--precision", type=click.Choice(["float32", "bfloat16"]), help="Number type of convolutions and attention."
)
@click.option("--seed", type=click.IntRange(0, 2**31), default=0, show_default=True, help="Seed of random numbers.")
@click.option("--from", "start", type=FILE_PATH, help="Initialise with the weights of the model in this folder.")
@click.option(
    "--extractor-weights", "extractor", type=FILE_PATH,
    help="Initialise the extractor from a model folder, or from a DepthSplat, Depth Anything V2, DINOv2 or UniMatch "
    "file.",
)  # fmt: skip
@click.option(
    "--freeze", "frozen", multiple=True, type=click.Choice(["receiver", "extractor"]),
    help="Do not train this part. Repeat the option for both.",
)  # fmt: skip
@click.option(
    "--keep", "kept_batches", type=click.IntRange(min=0), metavar="BATCHES",
    help="Keep so many batches per process in memory with the features of a frozen extractor, for shorter steps.",
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
    frozen: tuple[str, ...],
    entropy_steps: int,
    entropy_scenes: int,
    model: Path | None,
    device: str,
    **overrides: Any,
) -> None:
    """Train the networks. FOLDER receives the checkpoint last.pt, log.csv and samples/; training resumes from its
    checkpoint if there is one.

    Start several processes with torchrun, as in the last example, for data-parallel training.
    """
    _check_arguments(folder, (photographs, textures, validation, start, extractor), overrides)

    from fecocodec.training.configurations import configuration_named
    from fecocodec.training.entropy_phase import EntropyPhase, train_entropy_model
    from fecocodec.training.export import export_model
    from fecocodec.training.graphs.export import export_receiver
    from fecocodec.training.log import LOG_COLUMNS
    from fecocodec.training.loop import RunSettings, Trainer
    from fecocodec.training.processes import is_first, joined_processes
    from fecocodec.training.sources import open_sources

    from .device import require_rendering_device

    require_rendering_device(device)
    configuration = _overridden(configuration_named(name), {**overrides, "frozen": frozen})
    _check_options(configuration, entropy_steps, num_workers)
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
        for row in trainer.run():
            say("  ".join(f"{name} {row[name]:.4g}" for name in LOG_COLUMNS if name in row))
        if entropy_steps and trainer.step < configuration.schedule.num_steps:
            if is_first():
                warn("entropy model: not trained before the last step of the schedule; run the same command again")
        elif entropy_steps:
            for row in train_entropy_model(trainer, EntropyPhase(entropy_steps, entropy_scenes)):
                if is_first():
                    say("entropy model: " + "  ".join(f"{name} {value:.4g}" for name, value in row.items()))
        if model is not None and is_first():
            _require_finished(trainer.step, configuration.schedule.num_steps, model)
            export_model(trainer.checkpoint, model, configuration)
            if not configuration.is_paper:  # torch decodes the paper's method
                export_receiver(model)


def _check_arguments(folder: Path, inputs: tuple[Path | None, ...], overrides: dict[str, Any]) -> None:
    """Raise InputError or OutputError for paths and values that are wrong whatever the configuration is.

    Nothing that needs torch is loaded.
    """
    require_output_folder(folder)
    for path in inputs:
        if path is not None:
            require_input(path, "there is no such file or folder; check the path.")
    check_view_shares(overrides["view_shares"] or ())
    check_sizes(overrides["sizes"] or ())
    check_sizes([(overrides["side"],) * 2] if overrides["side"] is not None else ())
    for lmbda in overrides["lambda_range"] or ():
        quantise_lambda(lmbda)  # raises for a value outside the range


def _check_options(configuration: "Configuration", entropy_steps: int, num_workers: int) -> None:
    if configuration.sender.extractor == "adapted":
        raise InputError(
            "This configuration needs the network of its extractor; train it in Python (examples/larger_extractor.py)."
        )
    if configuration.is_paper and entropy_steps:
        raise InputError("The paper's method has no phase for the entropy model alone; leave out --entropy-steps.")
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


def _overridden(configuration: "Configuration", overrides: dict[str, Any]) -> "Configuration":
    """Return the configuration with the given options in place of its own values."""
    given = {name: value for name, value in overrides.items() if value is not None}
    if "side" in given:
        given["sizes"] = ((given["side"], given["side"]),)
    shapes = replace(configuration.shapes, **{name: given[name] for name in _SHAPE_FIELDS if name in given})
    schedule = replace(configuration.schedule, **{name: given[name] for name in _SCHEDULE_FIELDS if name in given})
    others: dict[str, Any] = {
        name: given[name] for name in ("lambda_range", "precision", "frozen", "kept_batches") if name in given
    }
    if configuration.is_paper and "lambda_range" in given:
        others["receiver"] = replace(configuration.receiver, lambda_range=given["lambda_range"])
    return replace(configuration, shapes=shapes, schedule=schedule, **others)
