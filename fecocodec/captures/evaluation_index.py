"""Evaluation index: the context frames and target frames of each scene, and the frames that guide the encoder.

    {"scene": {"context": [58, 133], "target": [84, 102, 129]}, "scene/wide": {..., "guide": [90]}, "skipped": null}

pixelSplat and DepthSplat use this format, without "guide". null marks scenes that are not evaluated; other fields, such
as "overlap", are ignored. A label after a slash distinguishes several entries of one scene.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

from fecocodec.errors import InputError
from fecocodec.input_file import read_json


@dataclass(frozen=True)
class IndexEntry:
    """An entry of an evaluation index: frames of a scene, from 0. guide: not coded; the sender learns from them."""

    name: str
    scene: str
    context: tuple[int, ...]
    target: tuple[int, ...]
    guide: tuple[int, ...] = ()


def read_index(path: Path) -> tuple[IndexEntry, ...]:
    """Return the entries that are not null, in the order of the file. Raises InputError if the index is not valid."""
    entries = read_json(path, "check the path, or write the index again")
    if not isinstance(entries, dict):
        raise InputError(f'{path}: not an evaluation index; write {{"scene": {{"context": [...], "target": [...]}}}}.')
    return tuple(_entry(path, name, value) for name, value in entries.items() if value is not None)


def _entry(path: Path, name: str, value: object) -> IndexEntry:
    context, target = ((value.get(part) if isinstance(value, dict) else None) for part in ("context", "target"))
    if not _is_frame_list(context) or not _is_frame_list(target):
        raise InputError(f"{path}, entry {name}: `context` and `target` must be lists of frame numbers from 0.")
    guide = value.get("guide") if isinstance(value, dict) else None
    if guide and (not _is_frame_list(guide) or {*guide} & {*context, *target}):
        raise InputError(f"{path}, entry {name}: `guide` must be a list of frame numbers in neither other list.")
    return IndexEntry(name, name.split("/")[0], tuple(context), tuple(target), tuple(guide or ()))


def _is_frame_list(value: object) -> TypeGuard[list[int]]:
    return isinstance(value, list) and len(value) > 0 and all(type(frame) is int and frame >= 0 for frame in value)
