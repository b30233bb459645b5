"""Batches whose frozen features are kept in memory and used in many steps.

With a frozen extractor, matching and F1 of a batch never change. Computing them takes most of a training step, so
batches are kept with them; a share of the steps draws a new batch, which replaces the oldest one.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from fecocodec.training.batch import Batch, Extracted
from fecocodec.training.batch_shapes import BatchShape

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
