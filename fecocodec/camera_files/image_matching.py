"""Match the images that a camera file names with the image files that are there, for all camera formats.

The folder in which most names exist is used. A name may differ from that of its file in case, Unicode form, encoding
(`%20`), suffix, and in the folders before it (`/scans/room/images/1.jpg`, `C:\\scan\\1.jpg`), where one file alone
fits.
"""

import os
import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from urllib.parse import unquote

from fecocodec.photographs.image_headers import (
    IMAGE_SUFFIXES,
    PHOTOGRAPH_FOLDERS,
    UNREAD_SUFFIXES,
    has_image_name,
)

_REDUCED = re.compile(r"images_(\d{1,2})")  # photographs reduced by this factor, such as images_4 of DL3DV
_LEVELS_ABOVE = 4  # as far as cameras are named below a scene folder, see `camera_names.walk`
_SUFFIXES = {*IMAGE_SUFFIXES, *UNREAD_SUFFIXES}

Parts = tuple[str, ...]


@dataclass(frozen=True)
class MatchedImages:
    """The image files of a camera file.

    names: as the camera file has them. paths: one for each name; one that does not exist is where the image was looked
    for. reduction: factor by which the images are smaller than those that were named, told by the name of their folder.
    remarks: one sentence if images are not where the camera file says.
    """

    names: tuple[str, ...]
    paths: tuple[Path, ...]
    reduction: int
    remarks: tuple[str, ...]


def match_images(cameras_path: Path, names: Sequence[str], usual: Sequence[Path]) -> MatchedImages:
    """Find the image files. usual: folders in which this format keeps images, from which names start.

    Looks there, then in `images`, `input` and `images_N` of these folders, then above the camera file.
    """
    listed = _Listings()
    wanted = [parts_of(name) for name in names]
    best = _Match(usual[0], 1, [None] * len(names))
    start = cameras_path if cameras_path.is_dir() else cameras_path.parent
    for places in (image_folders(usual), _folders_above(start)):
        for folder, reduction in places:
            found = _Match(folder, reduction, _find_all(listed, folder, names, wanted))
            if found.count > best.count:
                best = found
            if best.count == len(names):
                break
        if best.count:
            break
    skipped = best.skipped(wanted)
    paths = tuple(
        best.folder.joinpath(*parts[min(skipped, max(0, len(parts) - 1)) :]) if path is None else path
        for path, parts in zip(best.paths, wanted, strict=True)
    )
    return MatchedImages(tuple(names), paths, best.reduction, _remarks(cameras_path, names, wanted, best, usual))


def short_name(cameras_path: Path) -> str:
    """Return the name of a camera file for messages; `sparse/0` for a folder."""
    return "/".join(cameras_path.resolve().parts[-2:]) if cameras_path.is_dir() else cameras_path.name


def similar_key(name: str) -> str:
    """Return what names share that differ in case, Unicode form, encoding as a URL (`%20`), or kind of space only.

    Spaces and line breaks at their ends do not count.
    """
    with suppress(UnicodeError):  # names of files in a locale that is not UTF-8
        name = os.fsencode(name).decode()
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", unquote(name)).casefold()).strip()


def image_folders(roots: Sequence[Path]) -> Iterator[tuple[Path, int]]:
    """Yield folders that may hold the photographs of a scene and how many times smaller than named these are."""
    yield from ((root, 1) for root in roots)
    yield from ((root / name, 1) for root in roots for name in PHOTOGRAPH_FOLDERS if root / name not in roots)
    for root in roots:
        found = ((_REDUCED.fullmatch(name), root / name) for name in _Listing(root).folders)
        yield from sorted(((path, int(match[1])) for match, path in found if match), key=lambda place: place[1])


def _folders_above(folder: Path) -> Iterator[tuple[Path, int]]:
    for parent in folder.resolve().parents[:_LEVELS_ABOVE]:
        yield parent, 1
        yield parent / "images", 1


@dataclass(frozen=True)
class _Match:
    folder: Path
    reduction: int
    paths: list[Path | None]

    @property
    def count(self) -> int:
        return sum(path is not None for path in self.paths)

    def skipped(self, wanted: list[Parts]) -> int:
        """Return how many folders most names have before the part that was found."""
        pairs = zip(self.paths, wanted, strict=True)
        counts = Counter(
            len(parts) - len(path.parts) + len(self.folder.parts) for path, parts in pairs if path is not None
        )
        return max(0, counts.most_common(1)[0][0]) if counts else 0


class _Listing:
    """Files and folders in a folder, by exact and by similar names; empty if it cannot be read."""

    def __init__(self, folder: Path) -> None:
        self.files: set[str] = set()
        self.folders: set[str] = set()
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    if entry.is_dir():
                        self.folders.add(entry.name)
                    elif not entry.is_symlink() or os.path.exists(entry.path):
                        self.files.add(entry.name)
        except (OSError, ValueError):  # ValueError: an invalid file name
            return

    @cached_property
    def similar(self) -> dict[str, dict[str, list[str]]]:
        """Return files and folders by kind of similarity, then by the key that similar names share."""
        tables: dict[str, dict[str, list[str]]] = {
            kind: defaultdict(list) for kind in ("folder", "name", "stem", "start")
        }
        for name in sorted(self.folders):
            tables["folder"][similar_key(name)].append(name)
        for name in sorted(name for name in self.files if has_image_name(Path(name))):
            tables["name"][similar_key(name)].append(name)
            tables["stem"][similar_key(_stem(name))].append(name)
            tables["start"][similar_key(name.split(".")[0])].append(name)
        return tables

    def folder(self, name: str) -> str | None:
        return name if name in self.folders or name == ".." else self._similar("folder", name)

    def image(self, name: str) -> str | None:
        """Return the image with this name, else the only one with a similar name, else None."""
        if name in self.files:
            return name
        if _stem(name) == name:  # instant-ngp and 3DGS leave suffixes out
            exact = next((name + suffix for suffix in IMAGE_SUFFIXES if name + suffix in self.files), None)
            if exact:
                return exact
        kinds = {"name": name, "stem": _stem(name)} | ({"start": name} if "." not in name else {})  # 3DGS: to first dot
        for kind, key in kinds.items():
            if similar_key(key) in self.similar[kind]:
                return self._similar(kind, key)
        return None

    def _similar(self, kind: str, name: str) -> str | None:
        found = self.similar[kind].get(similar_key(name), [])
        return found[0] if len(found) == 1 else None


class _Listings(dict[Path, _Listing]):
    def __missing__(self, folder: Path) -> _Listing:
        self[folder] = _Listing(folder)
        return self[folder]

    def find(self, folder: Path, parts: Parts) -> Path | None:
        """Return the image at `parts` below a folder."""
        for part in parts[:-1]:
            below = self[folder].folder(part)
            if below is None:
                return None
            folder = folder / below
        name = self[folder].image(parts[-1])
        return None if name is None else folder / name


def _find_all(listed: _Listings, folder: Path, names: Sequence[str], wanted: list[Parts]) -> list[Path | None]:
    """Return the file of each name: the one at the longest end of its path. Names that share a file have none."""
    paths = [
        _existing(name)
        or _called(listed, folder, name)
        or next((path for start in range(len(parts)) if (path := listed.find(folder, parts[start:]))), None)
        for name, parts in zip(names, wanted, strict=True)
    ]
    claims: dict[Path | None, set[Parts]] = defaultdict(set)
    for path, parts in zip(paths, wanted, strict=True):
        claims[path].add(parts)
    return [
        path if len(claims[path]) == 1 or path == folder.joinpath(*parts) else None
        for path, parts in zip(paths, wanted, strict=True)
    ]


def _existing(name: str) -> Path | None:
    """Return an absolute path if it exists on this machine."""
    try:
        return Path(name) if os.path.isabs(name) and os.path.isfile(name) else None
    except (OSError, ValueError):
        return None


def _called(listed: _Listings, folder: Path, name: str) -> Path | None:
    """Return the file of exactly this name, if it has backslashes, as of an archive that was unpacked elsewhere."""
    path = folder / name
    return path if "\\" in name and path.name in listed[path.parent].files else None


def parts_of(name: str) -> Parts:
    """Return the folders and the file of a path as any system writes it."""
    return tuple(part for part in name.replace("\\", "/").split("/") if part not in ("", "."))


def _stem(name: str) -> str:
    """Return a name without the suffix of an image."""
    path = Path(name)
    return path.stem if path.suffix.lower() in _SUFFIXES else name


def _remarks(
    cameras_path: Path, names: Sequence[str], wanted: list[Parts], match: _Match, usual: Sequence[Path]
) -> tuple[str, ...]:
    """Return a sentence if images have other names or folders than the camera file says."""
    is_usual = match.folder in usual
    others = [
        (name, path)
        for name, parts, path in zip(names, wanted, match.paths, strict=True)
        if path not in (None, Path(name)) and not (is_usual and _is_called(path, match.folder, parts, name))
    ]
    if not others:
        return ()
    name, path = others[0]
    shown = next((path.relative_to(folder) for folder in usual if path.is_relative_to(folder)), path)
    rest = "" if len(others) == 1 else ", and so on"
    count, cameras = f"{len(others)} of {len(names)}", short_name(cameras_path)
    return (f"{count} images have another name or folder than in {cameras}: {shown} is used for {name}{rest}.",)


def _is_called(path: Path, folder: Path, parts: Parts, name: str) -> bool:
    """Return whether an image has the name that its camera gives, with or without suffix."""
    named = folder.joinpath(*parts)
    return path == folder / name or ("\\" not in name and named in (path, path.with_name(_stem(path.name))))
