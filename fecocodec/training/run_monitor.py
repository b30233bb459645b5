"""What a training run measures and draws of itself: scores of held-out scenes, and pictures of a few fixed scenes."""

from pathlib import Path

from fecocodec.training.batch import Batch
from fecocodec.training.log import append_lines
from fecocodec.training.processes import is_first
from fecocodec.training.sample_grids import draw_fixed_scenes, sample_grid, write_sample_grid
from fecocodec.training.samples import Sample
from fecocodec.training.trainer import Trainer
from fecocodec.training.validation import (
    draw_validation_scenes,
    means_of,
    validate,
    validation_codec,
    weights_replaced,
)


class RunMonitor:
    """Measures and draws the present networks of a trainer. Its scenes are drawn at first use."""

    def __init__(self, trainer: Trainer) -> None:
        self.trainer = trainer
        self._validation_scenes: tuple[Sample, ...] = ()
        self._fixed_scenes: list[Batch] = []

    def validate(self) -> dict[str, float]:
        """Measure the held-out scenes with the averaged weights, if there are any; returns columns of the log.

        Only the first process measures. Scores by lambda go to `validation.txt`.
        """
        trainer, settings = self.trainer, self.trainer.settings
        configuration = settings.configuration
        if trainer.sources.validation is None or not is_first():
            return {}
        if not self._validation_scenes:
            shape = configuration.shapes.usual
            self._validation_scenes = draw_validation_scenes(
                trainer.sources.validation, shape, settings.validation_scenes
            )
        with weights_replaced(trainer.networks, trainer.average):
            rows = validate(validation_codec(trainer.networks), self._validation_scenes, configuration.lambda_q_range)
        append_lines(settings.folder / "validation.txt", tuple(f"step {trainer.step}  {row}" for row in rows))
        return means_of(rows)

    def draw_samples(self) -> Path:
        """Render the fixed scenes with the present weights, write the image and return its path."""
        trainer, settings = self.trainer, self.trainer.settings
        if not self._fixed_scenes:
            scenes = draw_fixed_scenes(trainer.sources, settings.configuration.shapes.usual.size)
            self._fixed_scenes = [scene.to(settings.device) for scene in scenes]
        is_single = trainer.step < settings.configuration.schedule.one_stage_until
        num_stages = 1 if is_single else settings.configuration.receiver.num_stages
        grid = sample_grid(trainer.sender, trainer.receiver, self._fixed_scenes, trainer.coding, num_stages)
        return write_sample_grid(settings.folder, trainer.step, grid)
