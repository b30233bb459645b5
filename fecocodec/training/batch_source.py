"""The batches of a training run: drawn when they are needed, drawn ahead by workers, or kept with their features.

With a frozen extractor, matching and F1 of a batch never change. Computing them takes most of a training step, so
batches are kept with them; a share of the steps draws a new batch, which replaces the oldest one.
"""

import signal
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from fecocodec.errors import FecoError, InputError
from fecocodec.training.batch import Batch, BatchShape, Extracted
from fecocodec.training.configurations import Configuration, RunSettings
from fecocodec.training.processes import num_processes, process_rank
from fecocodec.training.sources import Sources, draw_batch

FRESH_SHARE = 0.15  # of the steps draw a new batch


@dataclass(frozen=True)
class KeptBatch:
    """A batch and its features, images and features in half precision. shape: as it was drawn."""

    shape: BatchShape
    batch: Batch
    extracted: Extracted


class KeptBatches:
    """A buffer of batches of one process, by shape; a batch leaves when `limit` newer ones have come."""

    def __init__(self, limit: int, lambda_q_range: tuple[int, int], fresh_share: float = FRESH_SHARE) -> None:
        """lambda_q_range: lambda of a kept batch is drawn anew at each use, log-uniform, both ends included.

        fresh_share: share of the calls of `take` that draw a new batch although there is a kept one.
        """
        self.limit, self.lambda_q_range, self.fresh_share = limit, lambda_q_range, fresh_share
        self._kept: deque[KeptBatch] = deque(maxlen=limit)

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, shape: BatchShape, batch: Batch, extracted: Extracted) -> KeptBatch:
        """Keep a batch with its features."""
        kept = KeptBatch(shape, replace(batch, images=batch.images.half()), extracted.half())
        self._kept.append(kept)
        return kept

    def take(
        self,
        shape: BatchShape,
        generator: torch.Generator,
        draw: Callable[[], Batch],
        extract: Callable[[Batch], Extracted],
    ) -> tuple[Batch, Extracted]:
        """Return a batch of this shape with its features: a kept one, or a new one that is then kept.

        draw: draws a batch of this shape. extract: computes its features.
        """
        candidates = [kept for kept in self._kept if kept.shape == shape]
        if not candidates or float(torch.rand((), generator=generator)) < self.fresh_share:
            batch = draw()
            chosen = self.add(shape, batch, extract(batch))
        else:
            chosen = candidates[int(torch.randint(len(candidates), (), generator=generator))]
        lowest, highest = self.lambda_q_range
        count = (len(chosen.batch.lambda_q),)
        lambda_q = torch.randint(lowest, highest + 1, count, generator=generator).to(chosen.batch.lambda_q.device)
        batch = replace(chosen.batch, images=chosen.batch.images.float(), lambda_q=lambda_q)
        return batch, chosen.extracted.float()


PREFETCHED = 4  # batches of each worker
_SEED_OF_STEP = 1_000_003


def shape_at(configuration: Configuration, seed: int, step: int) -> BatchShape:
    """Return the shape of the batches of a step, the same in every process, so that none waits for another."""
    return configuration.shapes.draw(torch.Generator().manual_seed(seed * _SEED_OF_STEP + step))


class BatchesByStep(Dataset[Batch | str]):
    """The batch of every step of one process. It depends on seed, rank and step alone, not on the number of workers."""

    def __init__(self, sources: Sources, configuration: Configuration, seed: int, rank: int, num_ranks: int) -> None:
        self.sources, self.configuration = sources, configuration
        self.seed, self.rank, self.num_ranks = seed, rank, num_ranks

    def __getitem__(self, step: int) -> Batch | str:
        """Return the batch of a step, or the message of the error: a worker would add its traceback to it."""
        configuration = self.configuration
        generator = torch.Generator().manual_seed((self.seed * self.num_ranks + self.rank) * _SEED_OF_STEP + step)
        share = configuration.schedule.photograph_share_at(step)
        sources = self.sources.at_step(step, self.rank, self.num_ranks)
        shape = shape_at(configuration, self.seed, step)
        try:
            return draw_batch(sources, generator, shape, share, configuration.lambda_q_range)
        except FecoError as error:
            return str(error)


def _outlive_signals(_worker: int) -> None:
    """Let a drawing process outlive a SIGTERM to its group: the training process still needs it to end its step."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


def batches_from(dataset: BatchesByStep, first_step: int, num_workers: int, device: str) -> Iterator[Batch]:
    """Yield the batches from `first_step` to the last step, drawn by worker processes.

    device: batches for a CUDA device are in pinned memory. Raises InputError where a batch cannot be drawn.
    """
    loader: DataLoader[Any] = DataLoader(
        dataset,
        batch_size=None,
        sampler=range(first_step, dataset.configuration.schedule.num_steps),
        num_workers=num_workers,
        prefetch_factor=PREFETCHED,
        worker_init_fn=_outlive_signals,
    )
    for batch in loader:
        if isinstance(batch, str):
            raise InputError(batch)
        yield batch if device == "cpu" else batch.mapped(Tensor.pin_memory)


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
