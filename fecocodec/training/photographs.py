"""Training samples from folders of posed photographs."""

from pathlib import Path

import numpy as np
import torch

from fecocodec.errors import InputError
from fecocodec.training.augmentation import CROP_SPREAD, augment
from fecocodec.training.frame_choice import choose_frames, context_pairs, relative_baselines
from fecocodec.training.posed_scene import read_posed_scene
from fecocodec.training.samples import Sample


class Photographs:
    """Draws scenes uniformly and frames by overlap and baseline, and augments them.

    Images are decoded on first use and kept in memory as bytes at their stored size.
    """

    def __init__(self, root: Path, spread: float = CROP_SPREAD) -> None:
        """root: a folder of scene folders, each with `transforms.json` and images. spread: see `augment`.

        Raises InputError if there is no scene or a scene cannot be used.
        """
        folders = sorted(path.parent for path in root.glob("*/transforms.json"))
        if not folders:
            raise InputError(f"{root}: no scene folders with transforms.json; give the folder that holds the scenes.")
        self._spread = spread
        self._scenes = [read_posed_scene(folder) for folder in folders]
        self._pairs = [
            context_pairs(scene.covisibility, relative_baselines(scene.extrinsics, scene.near, scene.far))
            for scene in self._scenes
        ]

    @property
    def scene_names(self) -> tuple[str, ...]:
        return tuple(scene.name for scene in self._scenes)

    @property
    def most_frames(self) -> int:
        """Number of frames of the largest scene, the limit of context views."""
        return max(len(scene) for scene in self._scenes)

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw overlapping context views and target views that two of them see; size: (height, width) in pixels.

        A scene with too few frames repeats target frames. Equal generator states give equal samples. Raises InputError
        if no scene has `num_context` frames.
        """
        rng = np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
        usable = [index for index, scene in enumerate(self._scenes) if len(scene) >= num_context]
        if not usable:
            raise InputError(f"num_context = {num_context}: no scene has that many frames; ask for fewer.")
        index = usable[int(rng.integers(len(usable)))]
        scene = self._scenes[index]
        frames = choose_frames(rng, scene.covisibility, self._pairs[index], num_context, num_target)
        return augment(rng, scene, frames, num_context, size, self._spread)
