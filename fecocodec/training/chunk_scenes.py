"""Training samples from RealEstate10K, ACID or DL3DV in the chunks of pixelSplat.

`VideoProtocol` chooses frames as DepthSplat trains, with a gap between the context views that grows with the steps.
Further context views are the farthest points among the camera centres (Xu et al., "DepthSplat", 2025; the sampling
between two frames is that of Charatan et al., "pixelSplat", 2024).
"""

from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from fecocodec.camera_files.chunks import VIDEO_BOUNDS, ChunkFolder, ChunkScene
from fecocodec.errors import InputError
from fecocodec.training.samples import CROP_SPREAD, Captured, Sample, augment, mirrored


@dataclass(frozen=True)
class VideoProtocol:
    """Least and largest number of frames between the first and the last context view.

    first_gaps: at step 0. gaps: from step `curriculum_steps` on; in between, both numbers change linearly.
    """

    gaps: tuple[int, int]
    first_gaps: tuple[int, int]
    curriculum_steps: int

    def gaps_at(self, step: int) -> tuple[int, int]:
        """Return the least and largest gap at a training step."""
        share = min(1.0, step / self.curriculum_steps) if self.curriculum_steps else 1.0
        least, largest = (
            first + int((last - first) * share) for first, last in zip(self.first_gaps, self.gaps, strict=True)
        )
        return least, largest


REALESTATE10K = VideoProtocol(gaps=(45, 135), first_gaps=(25, 45), curriculum_steps=30_000)
DL3DV = VideoProtocol(gaps=(20, 50), first_gaps=(20, 50), curriculum_steps=0)


def choose_farthest_frames(
    rng: np.random.Generator,
    centres: Float[np.ndarray, "frame 3"],
    gaps: tuple[int, int],
    num_context: int,
    num_target: int,
) -> list[int]:
    """Return context frames in order of time, then target frames, drawn uniformly from the stretch, ends included.

    centres: of the cameras. gaps: see `VideoProtocol`; a scene shorter than the least gap is used as a whole. The ends
    of the stretch are context views; each further one is the frame whose centre is farthest from those chosen before.
    """
    longest = min(gaps[1], len(centres) - 1)
    gap = int(rng.integers(min(max(gaps[0], num_context - 1), longest), longest + 1))
    first = int(rng.integers(len(centres) - gap))
    context = [first, first + gap] if num_context > 1 else [first]
    while len(context) < num_context:
        distances = np.linalg.norm(centres[first : first + gap + 1, None] - centres[context], axis=-1).min(axis=1)
        distances[np.array(context) - first] = -1.0
        context.append(first + int(distances.argmax()))
    return [*sorted(context), *rng.integers(first, first + gap + 1, num_target).tolist()]


VIDEO_GAPS = (45, 192)  # frames between the first and last context view: pixelSplat's bounded sampling
DL3DV_GAPS = (20, 50)  # and DepthSplat's for DL3DV, whose frames lie further apart
_MOST_TRIES = 100  # scenes drawn before giving up on finding one with enough frames
LANES = 8  # chunks that a process reads side by side; a worker reads one or more of them
SAMPLES_OF_A_VISIT = 16  # drawn from a chunk before the lane takes the next one: about the scenes of a chunk
_LENS_TOLERANCE = 1e-3  # largest difference of normalised intrinsics within a scene


class ChunkScenes:
    """Draws scenes uniformly. Context views are the ends of a random stretch of frames and further frames inside it;
    targets lie in between. Consecutive frames of these data sets overlap, so distance in time replaces overlap.

    Scenes that cannot be used are skipped; `Sample.skipped` says why.
    """

    def __init__(self, root: Path, spread: float = CROP_SPREAD, protocol: VideoProtocol | None = None) -> None:
        """root: folder of a split, such as `re10k/train`. spread: see `augment`.

        protocol: chooses frames, which are then cropped to the centre and mirrored at random, but not tinted; None for
        random crops, tints and frames. Raises InputError if the index is missing or damaged.
        """
        self._chunks = ChunkFolder(root)
        self._names = self._chunks.scene_names
        self._spread, self._protocol, self._step = spread, protocol, 0

    def at_step(self, step: int, rank: int, num_ranks: int) -> "ChunkScenes":
        """Return these scenes as process `rank` of `num_ranks` draws from them at a training step.

        Chunks are visited in random order, each once per pass over the data set, so that few files are open at a time.
        """
        visit, lane = divmod(step, LANES)
        number = (visit // SAMPLES_OF_A_VISIT * num_ranks + rank) * LANES + lane
        groups = self._chunks.names_by_chunk
        epoch, place = divmod(number, len(groups))
        chunk = int(np.random.default_rng(epoch).permutation(len(groups))[place])
        found = copy(self)
        found._names, found._step = groups[chunk], step
        return found

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw a sample, augmented by `augment`; size: (height, width) in pixels.

        A stretch with too few frames repeats target frames. Equal generator states give equal samples.
        Raises InputError if none of many scenes can be used.
        """
        rng = np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
        skipped: list[str] = []
        names = self._names
        for _ in range(_MOST_TRIES):
            try:
                scene = self._chunks.scene(names[int(rng.integers(len(names)))])
                if len(scene) > num_context:
                    sample = self._sample(rng, scene, num_context, num_target, size)
                    return replace(sample, skipped=tuple(skipped))
            except InputError as error:
                skipped.append(str(error))
            names = self._chunks.scene_names  # all scenes of this chunk may be unusable
        if skipped:
            raise InputError(f"{self._chunks.root}: none of {_MOST_TRIES} scenes can be used; the last: {skipped[-1]}")
        raise InputError(
            f"{self._chunks.root}: {_MOST_TRIES} scenes have no more than {num_context} frames; ask for fewer."
        )

    def _sample(
        self, rng: np.random.Generator, scene: ChunkScene, num_context: int, num_target: int, size: tuple[int, int]
    ) -> Sample:
        """Draw frames of a scene. Raises InputError if one of them is damaged, or they differ in size or lens."""
        if self._protocol is None:
            gaps = VIDEO_GAPS if scene.bounds == VIDEO_BOUNDS else DL3DV_GAPS
            frames = choose_stretch(rng, len(scene), gaps, num_context, num_target)
            return augment(rng, _captured(scene, frames), num_context, size, self._spread)
        gaps, centres = self._protocol.gaps_at(self._step), scene.extrinsics[:, :3, 3]
        frames = choose_farthest_frames(rng, centres, gaps, num_context, num_target)
        _require_equal_lenses(scene, frames)
        views = scene.views(tuple(frames), size=size)
        return Sample(mirrored(views) if rng.random() < 0.5 else views, num_context, None)


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


def _captured(scene: ChunkScene, frames: list[int]) -> Captured:
    """Decode these frames of a scene. Raises InputError if they differ in size or lens."""
    images = {frame: (scene.image(frame) * 255).round().to(torch.uint8) for frame in sorted(set(frames))}
    sizes = {image.shape[1:] for image in images.values()}
    _require_equal_lenses(scene, frames)
    if len(sizes) > 1:
        raise InputError(f"{scene.place}: its frames differ in size or lens; leave this scene out of the index.")
    names, lens = tuple(f"{scene.name}:{frame}" for frame in frames), scene.lens(frames[0], *sizes.pop())
    return Captured([images[frame] for frame in frames], names, lens, scene.extrinsics[frames], *scene.bounds)


def _require_equal_lenses(scene: ChunkScene, frames: list[int]) -> None:
    if float(np.ptp(scene.intrinsics[frames], axis=0).max()) > _LENS_TOLERANCE:
        raise InputError(f"{scene.place}: its frames differ in size or lens; leave this scene out of the index.")
