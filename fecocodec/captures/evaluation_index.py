"""Evaluation index: the context frames and target frames of each scene, and the frames that guide the encoder.

    {"scene": {"context": [58, 133], "target": [84, 102, 129]}, "scene/wide": {..., "guide": [90]}, "skipped": null}

pixelSplat and DepthSplat use this format, without "guide". null marks scenes that are not evaluated; other fields, such
as "overlap", are ignored; names that resemble these are refused. A label after a slash distinguishes several entries of
one scene.
"""

from collections import Counter
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard

from fecocodec.errors import InputError
from fecocodec.input_file import read_json

PARTS = ("context", "target", "guide")


@dataclass(frozen=True)
class IndexEntry:
    """An entry of an evaluation index: frames of a scene, from 0.

    target: may have context frames, too, as public indices do. guide: not coded; the sender learns from them.
    """

    name: str
    scene: str
    context: tuple[int, ...]
    target: tuple[int, ...]
    guide: tuple[int, ...] = ()


def read_index(path: Path) -> tuple[IndexEntry, ...]:
    """Return the entries that are not null, in the order of the file. Raises InputError if the index is not valid."""
    entries = read_json(path, "check the path, or write the index again", partial(_object, path))
    if not isinstance(entries, dict):
        raise InputError(f'{path}: not an evaluation index; write {{"scene": {{"context": [...], "target": [...]}}}}.')
    return tuple(_entry(path, name, value) for name, value in entries.items() if value is not None)


def _object(path: Path, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        name = Counter(name for name, _ in pairs).most_common(1)[0][0]
        raise InputError(
            f"{path}: the name {name} is there twice; remove one, or give entries labels, as in scene/second."
        )
    return found


def _entry(path: Path, name: str, value: object) -> IndexEntry:
    fields = value if isinstance(value, dict) else {}
    context, target, guide = (fields.get(part) for part in PARTS)
    for other in fields:
        if other not in PARTS and (meant := get_close_matches(other.lower(), PARTS, 1, 0.8)):
            raise InputError(f"{path}, entry {name}: has `{other}`; write `{meant[0]}`, or give it another name.")
    if not _is_frame_list(context) or not _is_frame_list(target):
        raise InputError(f"{path}, entry {name}: `context` and `target` must be lists of frame numbers from 0.")
    if guide and (not _is_frame_list(guide) or {*guide} & {*context, *target}):
        raise InputError(f"{path}, entry {name}: `guide` must be a list of frame numbers in neither other list.")
    for part, frames in zip(PARTS, (context, target, guide or ()), strict=True):
        if len({*frames}) < len(frames):
            frame = Counter(frames).most_common(1)[0][0]
            raise InputError(f"{path}, entry {name}: `{part}` has frame {frame} twice; name it once.")
    return IndexEntry(name, name.split("/")[0], tuple(context), tuple(target), tuple(guide or ()))


def _is_frame_list(value: object) -> TypeGuard[list[int]]:
    return isinstance(value, list) and len(value) > 0 and all(type(frame) is int and frame >= 0 for frame in value)
