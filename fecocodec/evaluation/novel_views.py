"""The novel-view protocol: read the context views, target views and guides of an entry, and render Gaussians there."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.camera_files.chunks import ChunkFolder, is_chunk_folder
from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views, joined
from fecocodec.input_file import input_digest
from fecocodec.limits import MAX_VIEWS
from fecocodec.rendering.rasterizer import render

PAIR_SIZE = (256, 256)  # (height, width) of the usual two-view protocol
SEVERAL_SIZE = (256, 448)  # (height, width) of the usual protocol with more views


def protocol_size(num_context: int) -> tuple[int, int]:
    """Return (height, width) in pixels to which views are cropped and resized: 256x256 for up to two, else 256x448."""
    return PAIR_SIZE if num_context <= 2 else SEVERAL_SIZE


@dataclass(frozen=True)
class EntryReader:
    """Read the views of an entry: context views first, then target views, then guides.

    root, size: see `open_scenes`. chunks: None where each scene is a folder. Raises InputError for a scene or frame
    that cannot be used.
    """

    root: Path
    size: tuple[int, int] | None
    chunks: ChunkFolder | None

    def __call__(self, entry: IndexEntry) -> Views:
        frames, shape = _frames(entry), self.size or protocol_size(len(entry.context))
        if self.chunks is not None:
            return self.chunks.scene(entry.scene).views(frames, size=shape)
        folder = _folder(self.root, entry)
        once = tuple(dict.fromkeys(frames))
        parts = [once[start : start + MAX_VIEWS] for start in range(0, len(once), MAX_VIEWS)]
        found = joined([read_views(folder, views=part, size=shape, background="white") for part in parts])
        return found.select([once.index(frame) for frame in frames])

    def digest(self, entry: IndexEntry) -> str:
        """Return a digest of the entry's frames, and of their photographs and cameras in chunks, else of all files of
        the scene. Raises InputError if one cannot be read.
        """
        digest = sha256(repr((entry.context, entry.target, entry.guide)).encode())
        if self.chunks is not None:
            scene = self.chunks.scene(entry.scene)
            frames = [frame for frame in _frames(entry) if frame < len(scene)]
            arrays = [scene.encoded[frame].numpy() for frame in frames]
            arrays += [cameras[frames].astype(np.float32) for cameras in (scene.extrinsics, scene.intrinsics)]
            for array in arrays:
                digest.update(array.tobytes())
        else:
            digest.update(input_digest(_folder(self.root, entry)).encode())
        return digest.hexdigest()[:16]


def open_scenes(root: Path, size: tuple[int, int] | None = None) -> EntryReader:
    """Return the reader of the entries of a folder of scenes.

    root: contains one folder per scene (`transforms.json`, COLMAP ...), or chunks in the format of pixelSplat. size:
    (height, width) in pixels; None for `protocol_size`. Raises InputError if the folder does not exist.
    """
    if not root.is_dir():
        raise InputError(f"{root}: there is no such folder; give the one that holds the scenes or chunks.")
    return EntryReader(root, size, ChunkFolder(root) if is_chunk_folder(root) else None)


def _frames(entry: IndexEntry) -> tuple[int, ...]:
    """Return all frames; those that come first set the bounds of depth."""
    return (*entry.context, *entry.target, *entry.guide)


def without_guides(views: Views, entry: IndexEntry) -> tuple[Views, Views | None]:
    """Return the context and target views of an entry, and its guides, of all views that were read."""
    count = len(entry.context) + len(entry.target)
    if not entry.guide:
        return views, None
    return views.select(list(range(count))), views.select(list(range(count, len(views.images))))


def _folder(root: Path, entry: IndexEntry) -> Path:
    folder = root / entry.scene
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such scene, but entry {entry.name} needs it; check ROOT and INDEX.")
    return folder


@torch.no_grad()
def render_views(gaussians: Gaussians, views: Views) -> Float[Tensor, "view 3 height width"]:
    """Render Gaussians at the cameras of the views: sRGB, clamped to [0, 1]."""
    return render(gaussians, views.cameras, views.image_size).color.clamp(0.0, 1.0)
