"""Find and read the cameras of a scene folder, in any supported format."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from fecocodec.camera_files.colmap import colmap_tables_elsewhere, find_colmap_model, read_colmap
from fecocodec.camera_files.colmap_tables import is_colmap_model
from fecocodec.camera_files.image_matching import short_name
from fecocodec.camera_files.llff import find_llff, read_llff
from fecocodec.camera_files.other_cameras import program_of, unread_cameras
from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.camera_files.realestate10k import find_realestate10k, read_realestate10k
from fecocodec.camera_files.transforms_json import (
    FILE_NAMES,
    find_cameras_json,
    find_transforms_json,
    holds_cameras,
    read_transforms_json,
)
from fecocodec.errors import InputError
from fecocodec.input_file import StrPath
from fecocodec.photographs.image_headers import (
    IMAGE_SUFFIXES,
    PHOTOGRAPH_FOLDERS,
    conversion_advice,
    has_image_name,
    is_unread,
)
from fecocodec.photographs.video_frames import is_video
from fecocodec.poses.unposed_photographs import absent_photographs, find_photographs

_ARCHIVE_SUFFIXES = (".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst")
_FINDERS = (find_transforms_json, find_colmap_model, find_realestate10k, find_cameras_json, find_llff)


def read_cameras(path: StrPath) -> PosedPhotographs:
    """Read the cameras of a scene folder or of a camera file, in the first format found.

    Images are not read. Raises InputError if there are no cameras or they cannot be read.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise InputError(f"{path}: no such folder; give the folder that holds images and cameras.")
        found = camera_files(path)
        if not found:
            raise InputError(f"{path}: {_missing(path)}")
        scene = _read(path, found[0])
        folder = path if path.is_dir() else path.parent
        others = _others(folder, found)
        remarks = _remarks(folder, found, others) if path.is_dir() else []
        posed_elsewhere = _images_of(folder, others)
    except (OSError, ValueError) as error:  # ValueError: an invalid file name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); check the path and its permissions.") from error
    return replace(scene, remarks=(*scene.remarks, *remarks), posed_elsewhere=posed_elsewhere)


def has_cameras(path: StrPath) -> bool:
    """Return whether there is a camera file, or nothing from which cameras could be estimated.

    Photographs without a camera file are the only case for which the answer is no.
    """
    path = Path(path)
    try:
        return bool(camera_files(path)) or not find_photographs(path)
    except (OSError, ValueError):  # `read_cameras` reports it
        return True


def cameras_above(folder: Path) -> Path | None:
    """Return the camera file in the parent of a folder if it has cameras of photographs in the folder, else None.

    Raises OSError if the parent cannot be read.
    """
    parent = folder.absolute().parent
    try:
        scene = read_cameras(parent) if camera_files(parent) else None
    except InputError:
        return None
    here = folder.resolve()
    photographs = scene.photographs if scene else []
    is_named = any(photograph.path.parent.resolve() == here and photograph.path.is_file() for photograph in photographs)
    return scene.cameras_path if scene and is_named else None


def unread_cameras_notes(folder: Path) -> list[str]:
    """Return sentences if photographs whose cameras are estimated lie beside camera files that are not read."""
    if not folder.is_dir():
        return []
    elsewhere = colmap_tables_elsewhere(folder)
    models = [path for path in elsewhere if is_colmap_model(path)]
    partial = [str(path.relative_to(folder)) for path in elsewhere if path not in models]
    files = [path for path in sorted(folder.glob("*.json")) if holds_cameras(path)]
    notes = list[str]()
    if unread := unread_cameras(folder, {*files, *(folder / path.relative_to(folder).parts[0] for path in elsewhere)}):
        convert = "to use them, convert them to a transforms.json or a COLMAP model"
        notes.append(f"cameras in {unread} are not read, and cameras are estimated; {convert}.")
    if partial:
        notes.append(
            f"{', '.join(partial)} has no images.bin or images.txt, and cameras are estimated; export it again."
        )
    if unusual := [*models, *files]:
        names = ", ".join(str(path.relative_to(folder)) for path in unusual)
        notes.append(
            f"cameras in {names} are not looked for, and cameras are estimated; to use them, give {unusual[0]}."
        )
    return notes


def camera_files(path: Path) -> list[Path]:
    """Return the camera files of all formats in a scene folder, or `path` if it is one; the first is to be read."""
    if path.is_file() and (program := program_of(path)):
        raise InputError(
            f"{path}: cameras of {program} are not read; convert them to a transforms.json or a COLMAP model, or give "
            "the folder of the photographs to estimate them."
        )
    return [found for find in _FINDERS if (found := find(path))]


def _read(path: Path, found: Path) -> PosedPhotographs:
    if found.is_dir() and found == find_colmap_model(path):
        return read_colmap(path)
    if found.suffix.lower() == ".npy":
        return read_llff(found)
    return read_realestate10k(found) if found.suffix.lower() == ".txt" else read_transforms_json(found)


def _others(folder: Path, found: list[Path]) -> list[Path]:
    """Return camera files of kinds that are read beside the first, which is read."""
    splits = [folder / name for name in FILE_NAMES if (folder / name).is_file()]
    return [path for path in dict.fromkeys((*found, *splits)) if path != found[0]]


def _images_of(folder: Path, others: list[Path]) -> frozenset[Path]:
    """Return the images of other camera files; not of COLMAP models, which may take seconds to read."""
    images = set[Path]()
    for path in others:
        with suppress(InputError):
            images |= {photograph.path for photograph in _read(folder, path).photographs} if path.is_file() else set()
    return frozenset(images)


def _remarks(folder: Path, found: list[Path], others: list[Path]) -> list[str]:
    """Return sentences on camera files beside the first, which is read."""
    notes = []
    if others:
        names = ", ".join(str(path.relative_to(folder)) for path in others)
        has, it = ("has", "it") if len(others) == 1 else ("have", "one of them")
        notes.append(f"{names} {has} cameras, too, which are not used; give {it} in place of the folder to use it.")
    tables = {folder / "cameras.txt"} if folder in found else set()  # the folder is itself a COLMAP model
    if unread := unread_cameras(folder, {*found, *others, *tables}):
        notes.append(f"cameras in {unread} are not read; those of {short_name(found[0])} are used.")
    return notes


def _missing(path: Path) -> str:
    """Return why an existing path gives no cameras, and what to do."""
    if not path.is_dir():
        if path.suffix.lower() in IMAGE_SUFFIXES:
            return "a photograph, not a camera file; give a folder of two or more photographs, or a camera file."
        if path.suffix.lower() in _ARCHIVE_SUFFIXES:
            return "an archive; unpack it and give the folder that holds the photographs."
        if is_unread(path):
            moving = ", or a moving one to MP4" if path.suffix.lower() == ".gif" else ""
            return f"a picture of a kind that is not read; {conversion_advice([path])}{moving}."
        return "not a camera file, nor a video by its name; give the folder that holds images and cameras."
    if not _has_images(path):
        if unread := [file for file in _files(path) if is_unread(file)]:
            kinds = ", ".join(sorted({file.suffix.lower() for file in unread}))
            return f"photographs of this kind cannot be read ({kinds}); {conversion_advice(unread)}."
        if absent := absent_photographs(path):
            return f"{absent[0].name} is not here but only linked to, or not downloaded; put the photographs here."
        if videos := sorted(file for file in _files(path) if is_video(file)):
            return f"no photographs found, but a video; give the file itself, {videos[0]}."
        if scenes := [folder for folder in sorted(path.iterdir()) if folder.is_dir() and camera_files(folder)]:
            return f"no photographs found, but {len(scenes)} folders with cameras; give one of them, as {scenes[0]}."
        return _elsewhere(path)
    return "no cameras found; add a transforms.json, a COLMAP model in sparse/0 or a RealEstate10K camera file."


def _elsewhere(folder: Path) -> str:
    """Return that there are no photographs in a folder, and in which folders below there are some."""
    found = sorted({path.parent for depth in ("*/*", "*/*/*", "*/*/*/*") for path in _images_at(folder, depth)})
    if not found:
        return "no photographs and no camera file found; give a folder that holds two or more photographs."
    if len(found) == 1:
        return f"no photographs found here, but in {found[0]}; give that folder."
    return (
        f"no photographs found here, but in {len(found)} folders below; give one of them, as {found[0]}, or put all "
        "photographs of the scene into one folder."
    )


def _images_at(folder: Path, pattern: str) -> Iterator[Path]:
    return (path for path in folder.glob(pattern) if has_image_name(path) and not path.parent.name.startswith("."))


def _has_images(folder: Path) -> bool:
    """Return whether the folder or its folder `images` holds a file with the name of an image."""
    return any(has_image_name(path) and path.exists() for path in _files(folder))


def _files(folder: Path) -> list[Path]:
    """Return what is in the folder and in its folders `images` and `input`."""
    places = (folder, *(folder / name for name in PHOTOGRAPH_FOLDERS))
    return [path for place in places if place.is_dir() for path in place.iterdir()]
