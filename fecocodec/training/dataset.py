"""Batches from the data sources, with scenes normalised as in the codec."""

from dataclasses import dataclass, replace

import torch

from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.training.batch import Batch
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.chunk_scenes import ChunkScenes
from fecocodec.training.samples import Sample, SampleSource


@dataclass(frozen=True)
class Sources:
    """Sources of samples. photographs: None to train on procedural scenes alone. validation: held-out scenes."""

    world: SampleSource
    photographs: SampleSource | None
    validation: SampleSource | None = None

    def at_step(self, step: int, rank: int, num_ranks: int) -> "Sources":
        """Return the sources of process `rank` of `num_ranks` at a training step; only chunks depend on it."""
        if not isinstance(self.photographs, ChunkScenes):
            return self
        return replace(self, photographs=self.photographs.at_step(step, rank, num_ranks))


def draw_batch(
    sources: Sources,
    generator: torch.Generator,
    shape: BatchShape,
    photograph_share: float,
    lambda_q_range: tuple[int, int] = (0, LAMBDA_Q_MAX),
) -> Batch:
    """Draw a batch. Each scene is photographed with probability `photograph_share`; lambda is log-uniform.

    lambda_q_range: least and largest `lambda_q`, both included. Depth of photographs is NaN.
    """
    samples = [draw_sample(sources, generator, shape, photograph_share) for _ in range(shape.num_scenes)]
    normalised = [normalise_scene(sample.views.cameras) for sample in samples]
    cameras = [cameras for cameras, _ in normalised]
    depths = [
        torch.full_like(sample.views.images[:, 0], float("nan")) if sample.depth is None else sample.depth / frame.scale
        for sample, (_, frame) in zip(samples, normalised, strict=True)
    ]
    lowest, highest = lambda_q_range
    return Batch(
        images=torch.stack([sample.views.images for sample in samples]),
        cameras=Cameras(
            *(torch.stack([getattr(c, name) for c in cameras]) for name in ("extrinsics", "intrinsics", "near", "far"))
        ),
        depth=torch.stack(depths).float(),
        num_context=shape.num_context,
        lambda_q=torch.randint(lowest, highest + 1, (shape.num_scenes,), generator=generator),
        skipped=tuple(sentence for sample in samples for sentence in sample.skipped),
    )


def draw_sample(sources: Sources, generator: torch.Generator, shape: BatchShape, photograph_share: float) -> Sample:
    """Draw one scene, photographed with probability `photograph_share` if there are photographs."""
    is_photograph = float(torch.rand((), generator=generator)) < photograph_share
    source = sources.photographs if is_photograph and sources.photographs is not None else sources.world
    return source.sample(generator, num_context=shape.num_context, num_target=shape.num_target, size=shape.size)
