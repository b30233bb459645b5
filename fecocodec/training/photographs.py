"""Training samples from folders of posed photographs, with frames chosen by overlap and baseline."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from fecocodec.camera_files.posed_photographs import require_numbers, require_usable
from fecocodec.camera_files.transforms_json import read_transforms_json
from fecocodec.errors import InputError
from fecocodec.geometry.frustum_overlap import frustum_overlap
from fecocodec.photographs.framing import framed_intrinsics
from fecocodec.photographs.image_headers import read_image_size
from fecocodec.photographs.images import read_image
from fecocodec.photographs.lens import Lens
from fecocodec.training.samples import CROP_SPREAD, Captured, Sample, augment

LEAST_OVERLAP, MOST_OVERLAP = 0.3, 0.9
LEAST_BASELINE = 0.02  # in depths; below it, disparity is a few pixels and does not determine depth

Pairs = list[tuple[int, int]]


def relative_baselines(
    extrinsics: Float[ndarray, "frame 4 4"], near: float, far: float
) -> Float[ndarray, "frame frame"]:
    """Return the distances between camera centres, divided by the depth in the middle of the inverse-depth range."""
    centres = extrinsics[:, :3, 3]
    typical_depth = 2.0 / (1.0 / near + 1.0 / far)
    distances: ndarray = np.linalg.norm(centres[:, None] - centres[None], axis=-1) / typical_depth
    return distances


def context_pairs(overlap: Float[ndarray, "frame frame"], baselines: Float[ndarray, "frame frame"]) -> Pairs:
    """Return the pairs whose overlap and baseline are in range; if there are none, the pair of largest overlap."""
    is_good = (overlap > LEAST_OVERLAP) & (overlap < MOST_OVERLAP) & (baselines > LEAST_BASELINE)
    first, second = np.nonzero(np.triu(is_good, 1))
    if len(first):
        return list(zip(first.tolist(), second.tolist(), strict=True))
    best = np.unravel_index(np.argmax(np.triu(overlap, 1)), overlap.shape)
    return [(int(best[0]), int(best[1]))]


def choose_frames(
    rng: np.random.Generator, overlap: Float[ndarray, "frame frame"], pairs: Pairs, num_context: int, num_target: int
) -> list[int]:
    """Return context frames in random order, connected by overlap, then target frames that overlap two of them.

    overlap: share of one frame's content that another frame sees, symmetric. pairs: from `context_pairs`. Context
    frames are distinct; target frames repeat if there are too few.
    """
    context = _connected_frames(rng, overlap, pairs, num_context)
    return [*context, *_target_frames(rng, overlap, context, num_target)]


def _connected_frames(
    rng: np.random.Generator, overlap: Float[ndarray, "frame frame"], pairs: Pairs, count: int
) -> list[int]:
    """Draw a pair, then add frames that overlap a chosen one; if none does, the frame of largest overlap."""
    frames = [int(frame) for frame in rng.permutation(pairs[int(rng.integers(len(pairs)))])][:count]
    while len(frames) < count:
        largest = overlap[frames].max(0)
        largest[frames] = -1.0
        candidates = np.flatnonzero((largest > LEAST_OVERLAP) & (largest < MOST_OVERLAP))
        frames.append(int(rng.choice(candidates)) if len(candidates) else int(largest.argmax()))
    return frames


def _target_frames(
    rng: np.random.Generator, overlap: Float[ndarray, "frame frame"], context: list[int], count: int
) -> list[int]:
    """Draw other frames with a probability that grows with their overlap with two context views."""
    support = np.sort(overlap[context], axis=0)[-2:].min(0)
    support[context] = -1.0
    candidates = np.flatnonzero(support > LEAST_OVERLAP)
    if len(candidates) < count:
        candidates = np.argsort(-support, kind="stable")[: min(count, max(len(support) - len(context), 1))]
    if len(candidates) < count:
        return [int(frame) for frame in rng.choice(candidates, count)]
    # Weighted sampling without replacement: sort by a random key to the power of 1 / weight
    # (Efraimidis and Spirakis, "Weighted random sampling with a reservoir", 2006).
    keys = rng.random(len(candidates)) ** (1 / np.maximum(support[candidates], 0.01))
    return [int(frame) for frame in candidates[np.argsort(-keys)[:count]]]


@dataclass(frozen=True)
class PosedScene:
    """Posed photographs in a folder; an image is decoded once, when it is first asked for.

    covisibility: share of what one frame sees that another sees too, symmetric.
    """

    paths: tuple[Path, ...]
    lens: Lens
    extrinsics: Float[np.ndarray, "frame 4 4"]
    near: float
    far: float
    covisibility: Float[np.ndarray, "frame frame"]
    _decoded: dict[int, Tensor] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.paths)

    def captured(self, frames: list[int]) -> Captured:
        """Return these frames. Raises InputError when a photograph cannot be used."""
        images, names = [self.image(frame) for frame in frames], tuple(self.paths[frame].name for frame in frames)
        return Captured(images, names, self.lens, self.extrinsics[frames], self.near, self.far)

    def image(self, frame: int) -> UInt8[Tensor, "3 height width"]:
        """The photograph of a frame at its stored size. Raises InputError when it cannot be used."""
        if frame not in self._decoded:
            image = read_image(self.paths[frame])
            if image.shape[1:] != (self.lens.height, self.lens.width):
                found, wanted = f"{image.shape[2]}x{image.shape[1]}", f"{self.lens.width}x{self.lens.height}"
                raise InputError(f"{self.paths[frame]}: is {found}, other frames are {wanted}; give all one size.")
            self._decoded[frame] = (image * 255).round().to(torch.uint8)
        return self._decoded[frame]


def read_posed_scene(folder: Path) -> PosedScene:
    """Read `transforms.json` with `near`, `far` and, if it is there, `covisibility`; images stay on disk for now.

    Covisibility becomes symmetric by taking the smaller of the two directions; without it, the overlap of what the
    cameras have in front of them stands in.
    Raises InputError when one of them is missing, the lens is distorted, or there is a single frame.
    """
    path = folder / "transforms.json"
    scene = read_transforms_json(path)
    photographs = scene.photographs
    require_usable(photographs, are_images_needed=False)
    if len(photographs) < 2:
        raise InputError(f"{path}: has one frame; a training scene needs two or more.")
    if scene.near is None or scene.far is None or not 0 < scene.near < scene.far:
        raise InputError(f"{path}: no near and far with 0 < near < far; write the bounds of depth at the top level.")
    height, width = read_image_size(photographs[0].path)
    lens = photographs[0].lens_for(width, height)
    if lens.has_distortion:
        raise InputError(f"{path}: the lens is distorted; undistort the images before training on them.")
    extrinsics = np.stack([photograph.camera_to_world for photograph in photographs])
    covisibility = _read_covisibility(path, len(photographs))
    if covisibility is None:
        intrinsics = np.tile(framed_intrinsics(lens, (height, width)), (len(photographs), 1, 1))
        covisibility = frustum_overlap(extrinsics, intrinsics, scene.near, scene.far)
    return PosedScene(
        paths=tuple(photograph.path for photograph in photographs),
        lens=lens,
        extrinsics=extrinsics,
        near=scene.near,
        far=scene.far,
        covisibility=np.minimum(covisibility, covisibility.T),
    )


def _read_covisibility(path: Path, num_frames: int) -> Float[np.ndarray, "frame frame"] | None:
    values = json.loads(path.read_text(encoding="utf-8-sig")).get("covisibility")
    if values is None:
        return None
    return require_numbers(values, (num_frames, num_frames), f"{path}, covisibility")


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
        return augment(rng, scene.captured(frames), num_context, size, self._spread)
