"""`fecosplat train`: train all networks on synthetic scenes and on photographs, or by a verb one part of a model."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import click

from fecocodec.config import LargeSenderConfig
from fecocodec.errors import InputError

from .command_line import add_common_options
from .options import FILE_PATH, device_option, threads_option
from .output import in_options, say, warn
from .paths import require_new_model, require_output_folder
from .process import ending_later
from .train_options import check_inputs, configuration_options, data_options, overridden, seed_option
from .train_verbs import detail, entropy, export_graphs, steps

if TYPE_CHECKING:
    from torch import nn

    from fecocodec.training.configurations import Configuration

DEFAULT_MINUTES = 60.0
PAPER_BATCH = 4  # scenes a step in all processes (paper, implementation details)


class WithVerbs(click.Command):
    """A command whose first argument may be a verb, which is a command with its own options."""

    verbs: ClassVar = {"entropy": entropy, "steps": steps, "detail": detail}

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if not args or args[0] not in self.verbs:
            return super().make_context(info_name, args, parent, **extra)
        verb = self.verbs[args[0]]
        add_common_options(verb)
        return verb.make_context(f"{info_name} {args[0]}", args[1:], parent, **extra)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_options(ctx, formatter)
        with formatter.section(f"Verbs ({ctx.command_path} VERB --help)"):
            formatter.write_dl([(name, verb.get_short_help_str(limit=90)) for name, verb in self.verbs.items()])


@click.command(
    "train",
    cls=WithVerbs,
    short_help="Train the networks.",
    epilog="""\b
Examples:
  fecosplat train runs/first --max-minutes 30
  fecosplat train runs/real --photographs scenes/ --textures textures/ --export weights/mine
  fecosplat train runs/square --views 2 --size 128x128 --scenes 2
  fecosplat train entropy weights/mine weights/next --photographs scenes/
  torchrun --nproc-per-node 4 -m fecosplat_cli train runs/paper --config paper-re10k --photographs re10k/train""",
)
@click.argument("folder", metavar="FOLDER", type=FILE_PATH)
@click.option(
    "--config", "name", default="compact", metavar="NAME",
    help="Training configuration: compact, paper-re10k, paper-dl3dv, paper-dl3dv-large, or a variant such as "
    "ablate-no-feedback (docs/paper_profile.md). Options below without a default override it.",
)  # fmt: skip
@data_options
@click.option(
    "--validation", type=FILE_PATH, help="Folder of scenes as --photographs, with other scenes, measured now and then."
)
@click.option(
    "--validate-every", type=click.IntRange(min=1), default=5_000, metavar="STEPS",
    help="Steps between two measurements of --validation.",
)  # fmt: skip
@click.option(
    "--keep-every", type=click.IntRange(min=1), default=25_000, metavar="STEPS",
    help="Steps between two checkpoints that are kept, step_*.pt.",
)  # fmt: skip
@click.option(
    "--workers", "num_workers", type=click.IntRange(min=0), default=0,
    help="Number of processes that draw batches ahead, per training process.",
)  # fmt: skip
@click.option(
    "--max-minutes", type=click.FloatRange(min=0, min_open=True),
    help="Save a checkpoint and stop after this time.  [default: 60, no limit for the paper's configurations]",
)  # fmt: skip
@configuration_options()
@seed_option
@click.option("--from", "start", type=FILE_PATH, help="Initialise with the weights of the model in this folder.")
@click.option(
    "--extractor-weights", "extractor", type=FILE_PATH, multiple=True,
    help="Initialise the extractor from a model folder, or from a DepthSplat, Depth Anything V2, DINOv2, UniMatch or "
    "GMFlow file. Repeat the option for files of several parts.",
)  # fmt: skip
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
    extractor: tuple[Path, ...],
    model: Path | None,
    device: str,
    **overrides: Any,
) -> None:
    """Train the networks. FOLDER receives the checkpoint last.pt, log.csv and samples/; training resumes from its
    checkpoint if there is one. Ctrl-C and SIGTERM save one.

    Start several processes with torchrun, as in the last example, for data-parallel training. Verbs train one part of
    a finished model.
    """
    require_output_folder(folder)
    if model is not None:
        require_new_model(model)
    check_inputs((photographs, textures, validation, start, *extractor), overrides)  # before torch is loaded

    from fecocodec.rendering.cuda import require_rendering_device
    from fecocodec.training.configurations import RunSettings, configuration_named
    from fecocodec.training.loop import train
    from fecocodec.training.model_weights import export_model
    from fecocodec.training.processes import is_first, joined_processes, num_processes
    from fecocodec.training.run_files import LOG_COLUMNS
    from fecocodec.training.same_run import fingerprint
    from fecocodec.training.sources import open_sources
    from fecocodec.training.trainer import Trainer

    require_rendering_device(device)
    configuration = overridden(configuration_named(name), overrides)
    _check_options(configuration, num_workers, extractor)
    with joined_processes(device) as own_device:
        sources = open_sources(photographs, textures, configuration, validation)
        settings = RunSettings(
            folder, configuration, max_minutes or _default_minutes(configuration), seed, own_device,
            num_workers=num_workers, validate_every=validate_every, keep_every=keep_every,
            origin={
                "configuration": name,
                "seed": str(seed),
                "photographs": fingerprint(photographs),
                "textures": fingerprint(textures),
                "start": fingerprint(start),
                "extractor_weights": fingerprint(*(() if _is_frozen(configuration) else extractor)),
            },
        )  # fmt: skip
        trainer = Trainer(settings, sources)
        if trainer.checkpoint.exists():
            trainer.resume(trainer.checkpoint)
            if is_first():
                say(f"{trainer.checkpoint}: {_state(trainer.step, configuration.schedule.num_steps)}")
        elif start is not None:
            trainer.start_from(start)
        if is_first():
            say(f"networks: {totals(trainer.receiver, trainer.sender)}")
        if trainer.step == 0 and is_first():
            for sentence in remarks_on_start(configuration, num_processes(), (*extractor, *filter(None, [start]))):
                warn(f"warning: {in_options(sentence)}")
        for source in extractor if trainer.step == 0 or _is_frozen(configuration) else ():
            report = trainer.start_extractor_from(source)
            for line in (f"extractor, from {source}: {report}", *report.table()):
                say(line)
        with ending_later() as is_ending:
            for row in train(trainer, is_ending):
                say("  ".join(f"{name} {row[name]:.4g}" for name in LOG_COLUMNS if name in row))
        if model is not None and is_first():
            _require_finished(trainer.step, configuration.schedule.num_steps, model)
            export_model(trainer.checkpoint, model, replace(configuration, sender=trainer.sender.config), start)
            export_graphs(model)


def _check_options(configuration: "Configuration", num_workers: int, extractor: tuple[Path, ...]) -> None:
    if _is_frozen(configuration) and len(extractor) != 1:
        raise InputError(
            "The extractor of this configuration is frozen; give DepthSplat-Base's file by `extractor_weights`, once."
        )
    if configuration.kept_batches and num_workers:
        raise InputError("Kept batches are drawn by the training process; leave out --workers, or --keep.")


def _is_frozen(configuration: "Configuration") -> bool:
    """Return whether the extractor is a frozen one, which checkpoints do not hold."""
    return configuration.sender.extractor == LargeSenderConfig.extractor


def _state(step: int, num_steps: int) -> str:
    return f"resuming at step {step} of {num_steps}" if step < num_steps else f"already finished, at step {step}"


def _default_minutes(configuration: "Configuration") -> float | None:
    return None if configuration.is_paper else DEFAULT_MINUTES


def _require_finished(step: int, num_steps: int, model: Path) -> None:
    if step < num_steps:
        raise InputError(
            f"{model}: nothing was exported, because the run stopped after {step} of {num_steps} steps; "
            f"run the same command again, or export these weights with --steps {step}."
        )


def totals(receiver: "nn.Module", sender: "nn.Module") -> str:
    """Return the numbers of parameters that the paper's Table 1 gives."""
    from fecocodec.sender.parameters import count_parameters

    of_receiver, of_sender = map(count_parameters, (receiver, sender))
    return f"{of_receiver:,} parameters at the receiver, {of_receiver + of_sender:,} in all"


def remarks_on_start(configuration: "Configuration", num_processes: int, weights: Sequence[Path]) -> tuple[str, ...]:
    """Return a sentence for each difference from the paper's start; none for other methods.

    weights: sources of initial weights of the extractor, empty for random ones.
    """
    if not configuration.is_paper:
        return ()
    remarks = []
    if not weights and configuration.sender.extractor == "depthsplat-small":
        remarks.append(
            "the extractor starts from random weights, the paper's from those of DepthSplat; give its file, or those "
            "of DINOv2 and GMFlow, by `extractor_weights`."
        )
    batch = configuration.shapes.num_scenes * num_processes
    if batch != PAPER_BATCH:
        remarks.append(
            f"a step has {batch} scene{'s' * (batch > 1)}, the paper's {PAPER_BATCH}; start {PAPER_BATCH} processes by "
            "torchrun, or set the scenes of each by `num_scenes`."
        )
    return tuple(remarks)
