"""The scenes of a batch: those in a folder, or those that a manifest names."""

import os
import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fecocodec.errors import InputError
from fecocodec.input_file import StrPath, read_text

_REMEDY = "give a folder of scenes, or a text file with one path a line"
_OF_THE_SYSTEM = ("__MACOSX", "@eaDir")  # folders that macOS writes in ZIP files, and network storage of Synology
_CAMERAS_OF_A_SCENE = ("transforms.json", "sparse")  # in a folder that is a scene itself


@dataclass(frozen=True)
class BatchScene:
    """One scene. name: stem of the output file. path: absolute path of the folder or file to read."""

    name: str
    path: Path


def scene_folders(source: StrPath, *, output: StrPath | None = None) -> tuple[BatchScene, ...]:
    """Return the scenes to encode: the subfolders of a folder, or the folders that a manifest names.

    Hidden subfolders and the folder `output` are left out. A manifest is a UTF-8 text file with one scene a line,
    `PATH` or `NAME<tab>PATH`; relative paths start at the folder of the manifest; empty lines and lines that start with
    `#` are ignored. Without a name, the scene is called as its folder.
    Raises InputError if there is no scene, a path is missing, or two scenes have one name.
    """
    source = _existing(Path(source))
    if source.is_file():
        return _named(_manifest_scenes(source, Path.is_dir, "folder"), source)
    if any((source / name).exists() for name in _CAMERAS_OF_A_SCENE):
        raise InputError(f"{source}: this folder is a scene; give the folder that contains the scene folders.")
    left_out = None if output is None else Path(output).absolute()
    folders = [path for path in listed(source) if path.is_dir() and path.absolute() != left_out]
    return _named([BatchScene(path.name, path.absolute()) for path in folders], source)


def coded_scenes(source: StrPath) -> tuple[BatchScene, ...]:
    """Return the scenes to decode: the `.fcs` files in a folder, or the files that a manifest names.

    Manifest and errors are those of `scene_folders`. Without a name, the scene is called as its file without `.fcs`.
    """
    source = _existing(Path(source))
    if source.is_file():
        return _named(_manifest_scenes(source, Path.is_file, "file"), source)
    files = [path for path in listed(source) if path.suffix.lower() == ".fcs" and path.is_file()]
    return _named([BatchScene(path.stem, path.absolute()) for path in files], source)


def shard_of(scenes: Sequence[BatchScene], number: int, count: int) -> tuple[BatchScene, ...]:
    """Return every `count`-th scene, from `number` (1 to `count`) on. Raises InputError for another number."""
    if not 1 <= number <= count:
        raise InputError(f"shard {number}/{count}: there is no such shard; give a number from 1 to {count}.")
    return tuple(scenes[number - 1 :: count])


def _existing(source: Path) -> Path:
    """Return a path that is a folder or a regular file. Raises InputError."""
    try:
        mode = os.stat(source).st_mode
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{source}: cannot be read ({reason}); give a folder of scenes or a manifest.") from error
    if not stat.S_ISDIR(mode) and not stat.S_ISREG(mode):
        raise InputError(f"{source}: this is a pipe or a device; give a folder of scenes or a manifest.")
    return source


def listed(folder: Path) -> list[Path]:
    """Return the entries of a folder that are neither hidden nor of the system, sorted by name. Raises InputError."""
    try:
        entries = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
        return [path for path in entries if path.name not in _OF_THE_SYSTEM]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror}); check its permissions.") from error


def _manifest_scenes(manifest: Path, is_kind: Callable[[Path], bool], kind: str) -> list[BatchScene]:
    """Return the scenes of a manifest. is_kind: whether a path is of the kind that is read, a "folder" or "file"."""
    scenes = []
    for number, line in enumerate(read_text(manifest, _REMEDY).splitlines(), start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        name, tab, entry = text.partition("\t")
        path = Path(os.path.abspath(manifest.absolute().parent / (entry.strip() if tab else name)))
        if not _is_there(path, is_kind):
            raise InputError(f"{manifest}, line {number}: there is no {kind} {path}; correct the path.")
        own_name = path.name if kind == "folder" else path.stem
        scenes.append(BatchScene(name.strip() if tab else own_name, path))
    return scenes


def _is_there(path: Path, is_kind: Callable[[Path], bool]) -> bool:
    try:
        return is_kind(path)
    except (OSError, ValueError):  # ValueError: an invalid file name
        return False


def _named(scenes: list[BatchScene], source: Path) -> tuple[BatchScene, ...]:
    """Return the scenes. Raises InputError if there is none, or if a name is no file name or not unique."""
    if not scenes:
        raise InputError(f"{source}: there are no scenes in it; give a folder of scenes or a manifest.")
    path_of: dict[str, Path] = {}
    for scene in scenes:
        if "/" in scene.name or scene.name.startswith(".") or not scene.name.isprintable() or not scene.name:
            raise InputError(f"{source}: {scene.name!r} cannot be the name of a scene; use that of a file.")
        key = scene.name.casefold()  # some file systems do not distinguish case
        if key in path_of:
            raise InputError(
                f"{source}: two scenes are called {scene.name} ({path_of[key]} and {scene.path}); name them in a "
                "manifest."
            )
        path_of[key] = scene.path
    return tuple(scenes)
