"""Training samples from folders of posed photographs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.formats.lens import Lens
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views
from fecocodec.training.posed_scene import PosedScene, read_posed_scene
from fecocodec.training.samples import Sample

_LEAST_COVISIBILITY, _MOST_COVISIBILITY = 0.3, 0.9


@dataclass(frozen=True)
class _Crop:
    """A window of a stored photograph: left and top in pixels, and its size (height, width) in pixels."""

    left: int
    top: int
    size: tuple[int, int]


class Photographs:
    """Draws scenes evenly, frames by how much of each other they see, and crops, flips and tints them.

    Images are decoded when first needed and kept as bytes at their stored size.
    """

    def __init__(self, root: Path) -> None:
        """root: a folder of scene folders, each with `transforms.json` (with `covisibility`) and images.

        Raises InputError when there is no scene, or a scene cannot be used.
        """
        folders = sorted(path.parent for path in root.glob("*/transforms.json"))
        if not folders:
            raise InputError(f"{root}: no scene folders with transforms.json; give the folder that holds the scenes.")
        self._scenes = [read_posed_scene(folder) for folder in folders]
        self._pairs = [_context_pairs(scene.covisibility) for scene in self._scenes]

    @property
    def scene_names(self) -> tuple[str, ...]:
        return tuple(scene.name for scene in self._scenes)

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Context views that overlap, target views that both see; size is (height, width) in pixels.

        A scene with fewer frames than asked for repeats target frames. The same for the same generator state.
        """
        rng = np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
        usable = [index for index, scene in enumerate(self._scenes) if len(scene) >= num_context]
        if not usable:
            raise InputError(f"num_context = {num_context}: no scene has that many frames; ask for fewer.")
        index = usable[int(rng.integers(len(usable)))]
        scene = self._scenes[index]
        context = _connected_frames(rng, scene.covisibility, self._pairs[index], num_context)
        frames = [*context, *_target_frames(rng, scene.covisibility, context, num_target)]
        return _augmented(rng, scene, frames, num_context, size)


def _context_pairs(covisibility: Float[ndarray, "frame frame"]) -> list[tuple[int, int]]:
    """Pairs that overlap, but not so much that there is nothing to learn; else the pair that overlaps most."""
    first, second = np.nonzero(np.triu((covisibility > _LEAST_COVISIBILITY) & (covisibility < _MOST_COVISIBILITY), 1))
    if len(first):
        return list(zip(first.tolist(), second.tolist(), strict=True))
    best = np.unravel_index(np.argmax(np.triu(covisibility, 1)), covisibility.shape)
    return [(int(best[0]), int(best[1]))]


def _connected_frames(
    rng: np.random.Generator, covisibility: Float[ndarray, "frame frame"], pairs: list[tuple[int, int]], count: int
) -> list[int]:
    """A random pair, grown by frames that overlap with a chosen one (or, where none does, that overlap most)."""
    frames = [int(frame) for frame in rng.permutation(pairs[int(rng.integers(len(pairs)))])][:count]
    while len(frames) < count:
        overlap = covisibility[frames].max(0)
        overlap[frames] = -1.0
        candidates = np.flatnonzero((overlap > _LEAST_COVISIBILITY) & (overlap < _MOST_COVISIBILITY))
        frames.append(int(rng.choice(candidates)) if len(candidates) else int(overlap.argmax()))
    return frames


def _target_frames(
    rng: np.random.Generator, covisibility: Float[ndarray, "frame frame"], context: list[int], count: int
) -> list[int]:
    """Other frames that see much of what two of the context views see; the likelier, the more they do."""
    support = np.sort(covisibility[context], axis=0)[-2:].min(0)
    support[context] = -1.0
    candidates = np.flatnonzero(support > _LEAST_COVISIBILITY)
    if len(candidates) < count:
        candidates = np.argsort(-support, kind="stable")[: min(count, max(len(support) - len(context), 1))]
    if len(candidates) < count:
        return [int(frame) for frame in rng.choice(candidates, count)]
    # The larger the random key to the power of 1 / weight, the likelier a frame with much support comes first
    # (Efraimidis and Spirakis, "Weighted random sampling with a reservoir", 2006).
    keys = rng.random(len(candidates)) ** (1 / np.maximum(support[candidates], 0.01))
    return [int(frame) for frame in candidates[np.argsort(-keys)[:count]]]


def _augmented(
    rng: np.random.Generator, scene: PosedScene, frames: list[int], num_context: int, size: tuple[int, int]
) -> Sample:
    """Crop, resize, perhaps mirror, and tint the frames; the cameras follow exactly."""
    crops = _crops(rng, (scene.lens.height, scene.lens.width), len(frames), size)
    images = [_resized(scene.image(frame), crop, size) for frame, crop in zip(frames, crops, strict=True)]
    intrinsics = torch.stack([_cropped_intrinsics(scene.lens, crop) for crop in crops])
    extrinsics = torch.from_numpy(scene.extrinsics[frames]).float()
    near, far = torch.tensor(scene.near, dtype=torch.float32), torch.tensor(scene.far, dtype=torch.float32)
    views = Views(
        images=_tinted(rng, torch.stack(images)),
        cameras=Cameras(extrinsics, intrinsics, near, far),
        names=tuple(scene.paths[frame].name for frame in frames),
    )
    return Sample(mirrored(views) if rng.random() < 0.5 else views, num_context, None)


def mirrored(views: Views) -> Views:
    """The world with x negated, seen by the mirrored cameras: a valid scene again.

    An image flipped left to right negates x of the camera axes; conjugating the extrinsics with diag(-1, 1, 1)
    negates x of the world as well, so that the rotation stays a rotation.
    """
    negate = torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0]))
    intrinsics = views.cameras.intrinsics.clone()
    intrinsics[:, 0, 2] = 1 - intrinsics[:, 0, 2]
    cameras = Cameras(negate @ views.cameras.extrinsics @ negate, intrinsics, views.cameras.near, views.cameras.far)
    return Views(views.images.flip(-1), cameras, views.names)


def _crops(rng: np.random.Generator, stored: tuple[int, int], count: int, size: tuple[int, int]) -> list[_Crop]:
    """Windows of the wanted shape and of one size, 60-100% of the largest that fits, each near one random place."""
    share = rng.uniform(0.6, 1.0) * min(stored[0] / size[0], stored[1] / size[1])
    window = (max(round(size[0] * share), 1), max(round(size[1] * share), 1))
    room = np.array([stored[0] - window[0], stored[1] - window[1]])
    # Photographers keep the subject in the middle, so far corners of different frames would not overlap.
    middle = rng.uniform(0.25, 0.75, 2)
    places = np.clip(middle + rng.uniform(-0.1, 0.1, (count, 2)), 0, 1) * room
    return [_Crop(int(left), int(top), window) for top, left in places]


def _resized(image: UInt8[Tensor, "3 h w"], crop: _Crop, size: tuple[int, int]) -> Float[Tensor, "3 height width"]:
    """Antialiased (area-weighted) resize of a window, to [0, 1]."""
    window = image[None, :, crop.top : crop.top + crop.size[0], crop.left : crop.left + crop.size[1]]
    resized = torch.nn.functional.interpolate(window, size, mode="bilinear", antialias=True, align_corners=False)
    return resized[0].float() / 255


def _cropped_intrinsics(lens: Lens, crop: _Crop) -> Float[Tensor, "3 3"]:
    """Normalised intrinsics of a window of a photograph."""
    height, width = crop.size
    focal_x, centre_x = lens.fx / width, (lens.cx - crop.left) / width
    focal_y, centre_y = lens.fy / height, (lens.cy - crop.top) / height
    return torch.tensor([[focal_x, 0.0, centre_x], [0.0, focal_y, centre_y], [0.0, 0.0, 1.0]])


def _tinted(rng: np.random.Generator, images: Float[Tensor, "view 3 h w"]) -> Float[Tensor, "view 3 h w"]:
    """One mild change of brightness, white balance and contrast for all views."""
    gain = torch.from_numpy(np.exp(rng.normal(0, 0.08) + rng.normal(0, 0.04, (3, 1, 1)))).float()
    gamma = float(np.exp(rng.normal(0, 0.1)))
    return (images * gain).clamp(0, 1) ** gamma
