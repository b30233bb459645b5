"""The batches of a training run: drawn when they are needed, kept with their features, or drawn ahead by workers."""

from collections.abc import Callable, Iterator

import torch

from fecocodec.training.batch import Batch, Extracted
from fecocodec.training.dataset import Sources, draw_batch
from fecocodec.training.kept_batches import KeptBatches
from fecocodec.training.prefetch import BatchesByStep, batches_from, shape_at
from fecocodec.training.processes import num_processes, process_rank
from fecocodec.training.run_settings import RunSettings


class BatchSource:
    """The batches of one process of a run."""

    def __init__(self, sources: Sources, settings: RunSettings, generator: torch.Generator) -> None:
        """generator: draws scenes and kept batches; workers have generators of their own."""
        self.sources, self.settings, self.generator = sources, settings, generator
        configuration = settings.configuration
        self.kept = KeptBatches(configuration.kept_batches, configuration.lambda_q_range)
        self._ahead: Iterator[Batch] | None = None

    def at(self, step: int, seed: int, extract: Callable[[Batch], Extracted]) -> tuple[Batch, Extracted | None]:
        """Return the batch of a step on the device of the run, and its features if the run keeps batches.

        seed: of the run. extract: computes the features of a frozen extractor.
        """
        configuration = self.settings.configuration
        if self.settings.num_workers:
            if self._ahead is None:  # workers start at the first step of this process
                self._ahead = self._drawn_ahead(step, seed)
            return next(self._ahead).to(self.settings.device), None
        shape = shape_at(configuration, seed, step)
        share = configuration.schedule.photograph_share_at(step)

        def draw() -> Batch:
            sources = self.sources.at_step(step, process_rank(), num_processes())
            batch = draw_batch(sources, self.generator, shape, share, configuration.lambda_q_range)
            return batch.to(self.settings.device)

        if not configuration.kept_batches:
            return draw(), None
        return self.kept.take(shape, self.generator, draw, extract)

    def _drawn_ahead(self, first_step: int, seed: int) -> Iterator[Batch]:
        settings = self.settings
        dataset = BatchesByStep(self.sources, settings.configuration, seed, process_rank(), num_processes())
        return batches_from(dataset, first_step, settings.num_workers, settings.device)
