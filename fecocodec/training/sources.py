"""Data sources of a training run, and batches from them, with scenes normalised as in the codec."""

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from fecocodec.camera_files.chunks import is_chunk_folder
from fecocodec.config import PaperSenderConfig
from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.training.batch import Batch, BatchShape
from fecocodec.training.chunk_scenes import ChunkScenes
from fecocodec.training.configurations import Configuration
from fecocodec.training.photographs import Photographs
from fecocodec.training.samples import CROP_SPREAD, Sample, SampleSource
from fecocodec.training.synthetic.scenes import SyntheticScenes
from fecocodec.training.synthetic.textures import pattern_textures, textures_from_folder, textures_from_photographs


@dataclass(frozen=True)
class Sources:
    """Sources of samples. photographs: None to train on synthetic scenes alone. validation: scenes to measure."""

    synthetic: SampleSource
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
    depths = [
        torch.full_like(sample.views.images[:, 0], float("nan")) if sample.depth is None else sample.depth / frame.scale
        for sample, (_, frame) in zip(samples, normalised, strict=True)
    ]
    lowest, highest = lambda_q_range
    return Batch(
        images=torch.stack([sample.views.images for sample in samples]),
        cameras=Cameras(*map(torch.stack, zip(*(cameras.fields() for cameras, _ in normalised), strict=True))),
        depth=torch.stack(depths).float(),
        num_context=shape.num_context,
        lambda_q=torch.randint(lowest, highest + 1, (shape.num_scenes,), generator=generator),
        skipped=tuple(sentence for sample in samples for sentence in sample.skipped),
    )


def draw_sample(sources: Sources, generator: torch.Generator, shape: BatchShape, photograph_share: float) -> Sample:
    """Draw one scene, photographed with probability `photograph_share` if there are photographs."""
    is_photograph = float(torch.rand((), generator=generator)) < photograph_share
    source = sources.photographs if is_photograph and sources.photographs is not None else sources.synthetic
    return source.sample(generator, num_context=shape.num_context, num_target=shape.num_target, size=shape.size)


NUM_PATTERNS, NUM_CROPS = 100, 300


def open_sources(
    photographs: Path | None, textures: Path | None, configuration: Configuration, validation: Path | None = None
) -> Sources:
    """Open synthetic scenes, textured with patterns, `textures` and crops of the photographs, and the photographs.

    photographs: folder of scene folders, or of chunks of RealEstate10K, ACID or DL3DV (which are not used as textures).
    All frames of a scene are cropped alike for an extractor with public geometry. validation: the same kind of folder,
    with other scenes, for measuring during training.
    Raises InputError if a folder has no usable content, or too few frames for the batches of the configuration.
    """
    if photographs is None and min(configuration.schedule.photograph_share) == 1.0:
        raise InputError("This configuration trains on photographs alone, but there are none; give `photographs`.")
    texture_set = pattern_textures(NUM_PATTERNS)
    if textures is not None:
        texture_set += textures_from_folder(textures)
    measured = None if validation is None else _open_photographs(validation, configuration)
    if photographs is None:
        return Sources(SyntheticScenes(texture_set), None, measured)
    scenes = _open_photographs(photographs, configuration)
    if isinstance(scenes, Photographs):
        texture_set += textures_from_photographs(photographs, NUM_CROPS)
    return Sources(SyntheticScenes(texture_set), scenes, measured)


def _open_photographs(folder: Path, configuration: Configuration) -> ChunkScenes | Photographs:
    """Open chunks, or a folder of scene folders. Raises InputError if no scene has the frames of the largest batch."""
    sender = configuration.sender  # public geometry projects all views with the intrinsics of one
    spread = 0.0 if isinstance(sender, PaperSenderConfig) and sender.geometry == "public" else CROP_SPREAD
    if is_chunk_folder(folder):
        return ChunkScenes(folder, spread, configuration.protocol)
    scenes = Photographs(folder, spread)
    most_views = max(count for count, _ in configuration.shapes.view_shares)
    if scenes.most_frames < most_views:
        raise InputError(
            f"{folder}: no scene has the {most_views} frames that batches may ask for; "
            "add photographs, or train fewer context views by `view_shares`."
        )
    return scenes
