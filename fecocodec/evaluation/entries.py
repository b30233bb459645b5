"""Read the views of an entry of an evaluation index."""

from collections.abc import Callable
from pathlib import Path

from fecocodec.camera_files.chunks import ChunkFolder, is_chunk_folder
from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views, joined
from fecocodec.limits import MAX_VIEWS

PAIR_SIZE = (256, 256)  # (height, width) of the usual two-view protocol
SEVERAL_SIZE = (256, 448)  # (height, width) of the usual protocol with more views

EntryReader = Callable[[IndexEntry], Views]


def protocol_size(num_context: int) -> tuple[int, int]:
    """Return (height, width) in pixels to which views are cropped and resized: 256x256 for up to two, else 256x448."""
    return PAIR_SIZE if num_context <= 2 else SEVERAL_SIZE


def open_scenes(root: Path, size: tuple[int, int] | None = None) -> EntryReader:
    """Return a function that reads the views of an entry: context views first, then target views, then guides.

    root: contains one folder per scene (`transforms.json`, COLMAP ...), or chunks in the format of pixelSplat. size:
    (height, width) in pixels; None for `protocol_size`. Raises InputError if the folder does not exist; the returned
    function raises it for a scene or frame that cannot be used.
    """
    if not root.is_dir():
        raise InputError(f"{root}: there is no such folder; give the one that holds the scenes or chunks.")
    if is_chunk_folder(root):
        chunks = ChunkFolder(root)
        return lambda entry: chunks.scene(entry.scene).views(_frames(entry), size=size or _size(entry))

    def read(entry: IndexEntry) -> Views:
        folder, frames, shape = _folder(root, entry), _frames(entry), size or _size(entry)
        parts = [frames[start : start + MAX_VIEWS] for start in range(0, len(frames), MAX_VIEWS)]
        return joined([read_views(folder, views=part, size=shape, background="white") for part in parts])

    return read


def _frames(entry: IndexEntry) -> tuple[int, ...]:
    """Return all frames; those that come first set the bounds of depth."""
    return (*entry.context, *entry.target, *entry.guide)


def without_guides(views: Views, entry: IndexEntry) -> tuple[Views, Views | None]:
    """Return the context and target views of an entry, and its guides, of all views that were read."""
    count = len(entry.context) + len(entry.target)
    if not entry.guide:
        return views, None
    return views.select(list(range(count))), views.select(list(range(count, len(views.images))))


def _size(entry: IndexEntry) -> tuple[int, int]:
    return protocol_size(len(entry.context))


def _folder(root: Path, entry: IndexEntry) -> Path:
    folder = root / entry.scene
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such scene, but entry {entry.name} needs it; check ROOT and INDEX.")
    return folder
