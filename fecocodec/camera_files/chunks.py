"""Data sets in pixelSplat's chunks: `000000.torch`, `000001.torch`, ... and an `index.json` that maps scenes to chunks.

RealEstate10K and ACID are published in this layout (Charatan et al., "pixelSplat", 2024), and DepthSplat's scripts
write DL3DV in it. A chunk is a list of records `{key, url, timestamps, cameras, images}`, written by `torch.save`. It
is loaded without executing code: only tensors, lists, strings and numbers are accepted.
"""

import zipfile
from collections import OrderedDict
from functools import cached_property
from pathlib import Path

import torch

from fecocodec.camera_files.chunk_scene import ChunkScene, chunk_scene
from fecocodec.errors import InputError
from fecocodec.input_file import read_json

INDEX_FILE = "index.json"
_MOST_OPEN = 16  # chunks kept open; they are mapped into memory, not read


def is_chunk_folder(path: Path) -> bool:
    """Return whether a folder has an index and chunks (such as `re10k/test`)."""
    return (path / INDEX_FILE).is_file() and next(path.glob("*.torch"), None) is not None


class ChunkFolder:
    """The scenes of one split of a data set, by name. Chunks are opened on demand."""

    def __init__(self, root: Path) -> None:
        """root: folder with `index.json` and the chunks. Raises InputError if the index is missing or invalid."""
        self.root = root
        self._file_of = _read_index(root / INDEX_FILE)
        self._open: OrderedDict[str, dict[str, object]] = OrderedDict()

    @property
    def scene_names(self) -> tuple[str, ...]:
        """Return the keys of all scenes, in the order of the index."""
        return tuple(self._file_of)

    @cached_property
    def names_by_chunk(self) -> tuple[tuple[str, ...], ...]:
        """Return the keys of the scenes of each chunk, in the order of the index."""
        groups: dict[str, list[str]] = {}
        for name, file in self._file_of.items():
            groups.setdefault(file, []).append(name)
        return tuple(tuple(names) for names in groups.values())

    def scene(self, name: str) -> ChunkScene:
        """Return the scene with this key. Raises InputError if there is none, or its chunk or record is damaged."""
        if name not in self._file_of:
            raise InputError(f"{self.root / INDEX_FILE}: has no scene {name}; check that the index is for this split.")
        file = self._file_of[name]
        records = self._records(file)
        if name not in records:
            raise InputError(
                f"{self.root / file}: has no scene {name}, though {INDEX_FILE} says so; write the index again."
            )
        return chunk_scene(records[name], self.root / file)

    def _records(self, file: str) -> dict[str, object]:
        if file not in self._open:
            self._open[file] = read_chunk(self.root / file)
            if len(self._open) > _MOST_OPEN:
                self._open.popitem(last=False)
        self._open.move_to_end(file)
        return self._open[file]


def read_chunk(path: Path) -> dict[str, object]:
    """Return the records of a chunk by key. Images stay encoded in the memory-mapped file.

    Raises InputError if the file is missing or damaged, or has anything other than plain data.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such chunk; download or convert this part of the data set.")
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: this is no chunk as torch.save writes it, or it is cut short; fetch it again.")
    try:
        records = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
    except Exception as error:  # a damaged pickle can raise any exception
        raise InputError(
            f"{path}: the chunk is damaged, or holds more than tensors and text ({type(error).__name__}); "
            "fetch it again."
        ) from error
    if not isinstance(records, list):
        raise InputError(f"{path}: holds no list of scenes; these are not chunks as pixelSplat writes them.")
    return {str(record.get("key")): record for record in records if isinstance(record, dict)}


def _read_index(path: Path) -> dict[str, str]:
    index = read_json(path, "give a folder of chunks with a whole index, such as re10k/test")
    if not isinstance(index, dict) or not index:
        raise InputError(f"{path}: is no object of scene to chunk; write the index again.")
    for scene, file in index.items():
        if not isinstance(file, str) or Path(file).name != file or file in ("", ".", ".."):
            raise InputError(f"{path}: scene {scene} is not in a file beside the index; write the index again.")
    return index
