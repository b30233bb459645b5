"""Training samples from RealEstate10K, ACID or DL3DV in the chunks of pixelSplat."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.formats.chunk_scene import VIDEO_BOUNDS, ChunkScene
from fecocodec.formats.chunks import ChunkFolder
from fecocodec.formats.lens import Lens
from fecocodec.training.augmentation import augment
from fecocodec.training.samples import Sample

VIDEO_GAPS = (45, 192)  # frames between the first and last context view: pixelSplat's bounded sampling
DL3DV_GAPS = (20, 50)  # and DepthSplat's for DL3DV, whose frames lie further apart
_MOST_TRIES = 100  # scenes drawn before giving up on finding one with enough frames
_LENS_TOLERANCE = 1e-3  # largest difference of normalised intrinsics within a scene


class ChunkScenes:
    """Draws scenes uniformly. Context views are the ends of a random stretch of frames and further frames inside it;
    targets lie in between. Consecutive frames of these data sets overlap, so distance in time replaces overlap."""

    def __init__(self, root: Path) -> None:
        """root: folder of a split, such as `re10k/train`. Raises InputError if its index is missing or damaged."""
        self._chunks = ChunkFolder(root)
        self._names = self._chunks.scene_names

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw a sample, augmented by `augment`; size: (height, width) in pixels.

        A stretch with too few frames repeats target frames. Equal generator states give equal samples.
        Raises InputError if a chunk is damaged or no scene has enough frames.
        """
        rng = np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
        scene = self._scene(rng, num_context)
        gaps = VIDEO_GAPS if scene.bounds == VIDEO_BOUNDS else DL3DV_GAPS
        frames = choose_stretch(rng, len(scene), gaps, num_context, num_target)
        return augment(rng, _capture(scene, frames), frames, num_context, size)

    def _scene(self, rng: np.random.Generator, num_context: int) -> ChunkScene:
        for _ in range(_MOST_TRIES):
            scene = self._chunks.scene(self._names[int(rng.integers(len(self._names)))])
            if len(scene) > num_context:
                return scene
        raise InputError(
            f"{self._chunks.root}: {_MOST_TRIES} scenes have no more than {num_context} frames; ask for fewer."
        )


def choose_stretch(
    rng: np.random.Generator, num_frames: int, gaps: tuple[int, int], num_context: int, num_target: int
) -> list[int]:
    """Return context frames in random order, then target frames.

    gaps: least and largest length of the stretch in frames. A scene shorter than the least gap is used as a whole. A
    single context view is anywhere in the stretch.
    """
    longest = min(gaps[1], num_frames - 1)
    gap = int(rng.integers(min(max(gaps[0], num_context), longest), longest + 1))
    first = int(rng.integers(num_frames - gap))
    inner = np.arange(first + 1, first + gap)
    ends = [first, first + gap] if num_context > 1 else [int(rng.integers(first, first + gap + 1))]
    context = [*ends, *rng.choice(inner, num_context - len(ends), replace=False).tolist()]
    others = np.setdiff1d(np.arange(first, first + gap + 1), context)
    targets = rng.choice(others, num_target, replace=len(others) < num_target)
    return [*rng.permutation(context).tolist(), *targets.tolist()]


@dataclass(frozen=True)
class _ChunkCapture:
    """A `Capture` with only some frames decoded."""

    scene: ChunkScene
    lens: Lens
    images: dict[int, UInt8[Tensor, "3 _ _"]]

    @property
    def extrinsics(self) -> Float[np.ndarray, "frame 4 4"]:
        return self.scene.extrinsics

    @property
    def near(self) -> float:
        return self.scene.bounds[0]

    @property
    def far(self) -> float:
        return self.scene.bounds[1]

    def frame_name(self, frame: int) -> str:
        return f"{self.scene.name}:{frame}"

    def image(self, frame: int) -> UInt8[Tensor, "3 height width"]:
        return self.images[frame]


def _capture(scene: ChunkScene, frames: list[int]) -> _ChunkCapture:
    """Decode these frames of a scene. Raises InputError if they differ in size or lens."""
    images = {frame: (scene.image(frame) * 255).round().to(torch.uint8) for frame in sorted(set(frames))}
    sizes = {image.shape[1:] for image in images.values()}
    lenses = scene.intrinsics[frames]
    if len(sizes) > 1 or float(np.ptp(lenses, axis=0).max()) > _LENS_TOLERANCE:
        raise InputError(f"{scene.place}: its frames differ in size or lens; leave this scene out of the index.")
    return _ChunkCapture(scene, scene.lens(frames[0], *sizes.pop()), images)
