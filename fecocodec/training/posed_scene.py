"""A scene folder of the training set: photographs, cameras, depth bounds and how much frames see of each other."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fecocodec.camera_files.posed_photographs import require_numbers, require_usable
from fecocodec.camera_files.transforms_json import read_transforms_json
from fecocodec.errors import InputError
from fecocodec.geometry.frustum_overlap import frustum_overlap
from fecocodec.photographs.image_headers import read_image_size
from fecocodec.photographs.images import read_image
from fecocodec.photographs.lens import Lens


@runtime_checkable
class Capture(Protocol):
    """Frames of one scene taken with one camera, wherever they are stored.

    extrinsics: camera-to-world, OpenCV axes. near, far: in scene units.
    """

    @property
    def lens(self) -> Lens: ...
    @property
    def extrinsics(self) -> Float[np.ndarray, "frame 4 4"]: ...
    @property
    def near(self) -> float: ...
    @property
    def far(self) -> float: ...
    def frame_name(self, frame: int) -> str: ...
    def image(self, frame: int) -> UInt8[Tensor, "3 height width"]: ...


@dataclass(frozen=True)
class PosedScene:
    """A `Capture` in a folder; an image is decoded once, when it is first asked for.

    covisibility: share of what one frame sees that another sees too, symmetric.
    """

    name: str
    paths: tuple[Path, ...]
    lens: Lens
    extrinsics: Float[np.ndarray, "frame 4 4"]
    near: float
    far: float
    covisibility: Float[np.ndarray, "frame frame"]
    _decoded: dict[int, Tensor] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.paths)

    def frame_name(self, frame: int) -> str:
        return self.paths[frame].name

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
        covisibility = frustum_overlap(extrinsics, _normalised(lens, len(photographs)), scene.near, scene.far)
    return PosedScene(
        name=folder.name,
        paths=tuple(photograph.path for photograph in photographs),
        lens=lens,
        extrinsics=extrinsics,
        near=scene.near,
        far=scene.far,
        covisibility=np.minimum(covisibility, covisibility.T),
    )


def _normalised(lens: Lens, num_frames: int) -> Float[np.ndarray, "frame 3 3"]:
    matrix = [
        [lens.fx / lens.width, 0.0, lens.cx / lens.width],
        [0.0, lens.fy / lens.height, lens.cy / lens.height],
        [0.0, 0.0, 1.0],
    ]
    return np.tile(np.array(matrix), (num_frames, 1, 1))


def _read_covisibility(path: Path, num_frames: int) -> Float[np.ndarray, "frame frame"] | None:
    values = json.loads(path.read_text(encoding="utf-8-sig")).get("covisibility")
    if values is None:
        return None
    return require_numbers(values, (num_frames, num_frames), f"{path}, covisibility")
