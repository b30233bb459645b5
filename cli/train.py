"""`fecosplat train`: train the compact profile on procedural scenes and photographs."""

from pathlib import Path

import click

from .options import FILE_PATH, threads_option
from .output import say


@click.command(
    "train",
    short_help="Train the networks.",
    epilog="""\b
Examples:
  fecosplat train runs/first --minutes 30
  fecosplat train runs/real --photographs scenes/ --textures textures/ --export weights/mine
  torchrun --nproc-per-node 2 -m fecosplat_cli train runs/real --photographs scenes/""",
)
@click.argument("folder", metavar="FOLDER", type=FILE_PATH)
@click.option("--photographs", type=FILE_PATH, help="Folder of posed scenes (transforms.json with covisibility).")
@click.option("--textures", type=FILE_PATH, help="Folder of images for procedural surfaces, besides built-in patterns.")
@click.option("--minutes", type=float, default=60.0, show_default=True, help="Stop cleanly after so long.")
@click.option("--steps", type=int, default=9000, show_default=True, help="Length of the schedule.")
@click.option("--one-stage-steps", type=int, default=1000, show_default=True, help="Steps that train stage 1 alone.")
@click.option("--bypass-steps", type=int, default=1400, show_default=True, help="Steps before the rate counts.")
@click.option("--scenes", type=int, default=2, show_default=True, help="Scenes a step and process.")
@click.option("--views", type=int, default=2, show_default=True, help="Context views of a scene.")
@click.option("--side", type=int, default=128, show_default=True, help="Training image side, a multiple of 32.")
@click.option("--learning-rate", type=float, default=5e-4, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option(
    "--photograph-share", type=float, nargs=2, default=(0.4, 0.6), show_default=True, help="At start and end."
)
@click.option("--depth-weight", type=float, nargs=2, default=(1.0, 0.1), show_default=True, help="At start and end.")
@click.option("--from", "start", type=FILE_PATH, help="Begin with the weights of the model in this folder.")
@click.option("--export", "model", type=FILE_PATH, help="When done, write the weights files of a model to this folder.")
@threads_option
def command(
    folder: Path,
    photographs: Path | None,
    textures: Path | None,
    minutes: float,
    steps: int,
    one_stage_steps: int,
    bypass_steps: int,
    scenes: int,
    views: int,
    side: int,
    learning_rate: float,
    seed: int,
    photograph_share: tuple[float, float],
    depth_weight: tuple[float, float],
    start: Path | None,
    model: Path | None,
) -> None:
    """Train in FOLDER, going on from its checkpoint if there is one; writes log.csv and last.pt there.

    Started by torchrun, as in the last example, several processes train together.
    """
    from fecocodec.training.dataset import BatchShape
    from fecocodec.training.export import export_model
    from fecocodec.training.log import LOG_COLUMNS
    from fecocodec.training.loop import RunSettings, Trainer
    from fecocodec.training.processes import is_first, joined_processes
    from fecocodec.training.schedule import Schedule
    from fecocodec.training.sources import open_sources

    shape = BatchShape(scenes, views, num_target=2, size=(side, side))
    schedule = Schedule(
        steps,
        one_stage_steps,
        bypass_steps,
        learning_rate,
        photograph_share=photograph_share,
        disparity_weight=depth_weight,
    )
    with joined_processes():
        trainer = Trainer(RunSettings(folder, minutes, shape, schedule, seed), open_sources(photographs, textures))
        if trainer.checkpoint.exists():
            trainer.resume(trainer.checkpoint)
        elif start is not None:
            trainer.start_from(start)
        for row in trainer.run():
            say("  ".join(f"{name} {row[name]:.4g}" for name in LOG_COLUMNS if name in row))
        if model is not None and is_first():
            export_model(trainer.checkpoint, model)
