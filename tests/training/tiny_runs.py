"""Runs as small as they can be: one synthetic scene of three views of 64x64 pixels a step."""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from fecocodec.training.batch import Batch, BatchShape, BatchShapes
from fecocodec.training.configurations import Configuration, RunSettings
from fecocodec.training.optimisation import Schedule
from fecocodec.training.sources import Sources, draw_batch
from fecocodec.training.synthetic.scenes import SyntheticScenes
from fecocodec.training.synthetic.textures import pattern_textures
from fecocodec.training.trainer import Trainer

SHAPES = BatchShapes(num_scenes=1, view_shares=((2, 1.0),), num_target=1, sizes=((64, 64),))


def synthetic_sources() -> Sources:
    return Sources(SyntheticScenes(pattern_textures(13)), None)


def synthetic_batch(num_scenes: int = 1, num_context: int = 2, num_target: int = 1, seed: int = 0) -> Batch:
    shape = BatchShape(num_scenes, num_context, num_target, (64, 64))
    return draw_batch(synthetic_sources(), torch.Generator().manual_seed(seed), shape, 0.0)


def tiny_trainer(
    folder: Path, schedule: Schedule, sources: Sources | None = None, *, settings: Any = None, **configuration: Any
) -> Trainer:
    """settings: further fields of `RunSettings`. configuration: further fields of `Configuration`."""
    folder.mkdir(parents=True, exist_ok=True)
    options = {"max_minutes": 5.0, "samples_every_minutes": float("inf"), **(settings or {})}
    run = RunSettings(folder, Configuration(SHAPES, schedule, **configuration), **options)
    return Trainer(run, synthetic_sources() if sources is None else sources)


def copied(networks: nn.Module) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in networks.state_dict().items()}


def changed(networks: nn.Module, before: dict[str, Tensor]) -> set[str]:
    """Names of the tensors that are not what they were."""
    return {name for name, value in networks.state_dict().items() if not torch.equal(value, before[name])}
