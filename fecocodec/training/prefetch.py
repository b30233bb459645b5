"""Batches drawn ahead by worker processes, so that the device does not wait for the data."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import torch
from torch.utils.data import DataLoader, Dataset

from fecocodec.errors import FecoError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.training.batch import Batch
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources, draw_batch

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
        collate_fn=_unchanged,
    )
    for batch in loader:
        if isinstance(batch, str):
            raise InputError(batch)
        yield batch if device == "cpu" else pinned(batch)


def pinned(batch: Batch) -> Batch:
    """Return a batch in pinned memory, from which copies to a CUDA device do not block."""
    cameras = Cameras(*(field.pin_memory() for field in batch.cameras.fields()))
    images, depth, lambda_q = (tensor.pin_memory() for tensor in (batch.images, batch.depth, batch.lambda_q))
    return replace(batch, images=images, cameras=cameras, depth=depth, lambda_q=lambda_q)


def _unchanged(batch: Any) -> Any:
    return batch
