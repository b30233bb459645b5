"""Find and read the cameras of a scene folder, in any supported format."""

from dataclasses import replace
from pathlib import Path

from fecocodec.camera_files.camera_names import ARCHIVE_SUFFIXES, has_camera_name
from fecocodec.camera_files.formats import camera_files, cameras_elsewhere, named_images, read_format
from fecocodec.camera_files.image_matching import short_name
from fecocodec.camera_files.other_cameras import unread_cameras
from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.camera_files.realestate10k import realestate10k_files
from fecocodec.camera_files.transforms_json import FILE_NAMES
from fecocodec.camera_files.unused_cameras import CONVERT, unread_cameras_notes
from fecocodec.errors import InputError, one_sentence
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


def read_cameras(path: StrPath, *, are_images_needed: bool = True) -> PosedPhotographs:
    """Read the cameras of a scene folder or of a camera file, in the first format found.

    Images are not read. are_images_needed: whether to tell of these, too, if there are no cameras.
    Raises InputError if there are no cameras or they cannot be read.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise InputError(f"{path}: no such folder; check the path.")
        found = camera_files(path)
        if not found:
            raise InputError(f"{path}: {why_no_cameras(path, are_images_needed=are_images_needed)}")
        scene = read_format(path, found[0])
        folder = path if path.is_dir() else path.parent
        others = _others(folder, found)
        remarks = _remarks(folder, found, others) if path.is_dir() else []
        # Images of other COLMAP models are not listed: these may take seconds to read.
        posed_elsewhere = frozenset(image for path in others if path.is_file() for image in named_images(path))
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


def _others(folder: Path, found: list[Path]) -> list[Path]:
    """Return camera files of kinds that are read beside the first, which is read."""
    further = [path for name in FILE_NAMES if (path := folder / name).is_file()] + realestate10k_files(folder)
    return [path for path in dict.fromkeys((*found, *further)) if path != found[0]]


def _remarks(folder: Path, found: list[Path], others: list[Path]) -> list[str]:
    """Return sentences on camera files beside the first, which is read."""
    notes = []
    if others:
        names = ", ".join(str(path.relative_to(folder)) for path in others)
        has, it = ("has", "it") if len(others) == 1 else ("have", "one of them")
        notes.append(f"{names} {has} cameras, too, which are not used; give {it} in place of the folder to use it.")
    known = {*found, *others, *cameras_elsewhere(folder)}
    if folder in found:  # it is itself a COLMAP model
        known |= {folder / "cameras.bin", folder / "cameras.txt"}
    if unread := unread_cameras(folder, known):
        notes.append(f"cameras in {unread} are not read; those of {short_name(found[0])} are used.")
    return notes


def why_no_cameras(path: Path, *, are_images_needed: bool = True) -> str:
    """Return why an existing path gives no cameras, and what to do."""
    if not path.is_dir():
        return _of_file(path)
    if are_images_needed and not any(has_image_name(file) and file.exists() for file in _files(path)):
        return _without_photographs(path)
    if notes := unread_cameras_notes(path, outcome=""):
        return one_sentence(["no cameras found", *notes])
    return "no cameras found; add a transforms.json, a COLMAP model in sparse/0 or a RealEstate10K camera file."


def _of_file(path: Path) -> str:
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return "a photograph, not a camera file; give a folder of two or more photographs, or a camera file."
    if path.suffix.lower() in ARCHIVE_SUFFIXES:
        return "an archive; unpack it and give the folder that holds the photographs."
    if is_unread(path):
        moving = ", or a moving one to MP4" if path.suffix.lower() == ".gif" else ""
        return f"a picture of a kind that is not read; {conversion_advice([path])}{moving}."
    if has_camera_name(path):
        return f"cameras of this kind are not read; {CONVERT}, or give the folder of the photographs to estimate them."
    return "not a camera file, nor a video by its name; give the folder that holds images and cameras."


def _without_photographs(path: Path) -> str:
    if unread := [file for file in _files(path) if is_unread(file)]:
        kinds = ", ".join(sorted({file.suffix.lower() for file in unread}))
        return f"photographs of this kind cannot be read ({kinds}); {conversion_advice(unread)}."
    if absent := absent_photographs(path):
        return f"{absent[0].name} is not here but only linked to, or not downloaded; put the photographs here."
    if videos := sorted(file for file in _files(path) if is_video(file)):
        return f"no photographs found, but a video; give the file itself, {videos[0]}."
    scenes = [folder for folder in sorted(path.iterdir()) if folder.is_dir() and camera_files(folder)]
    if len(scenes) > 1:
        return f"no photographs found, but {len(scenes)} folders with cameras; give one of them, as {scenes[0]}."
    elsewhere = cameras_elsewhere(path)
    with_images = (found for found in (*scenes, *elsewhere) if any(image.is_file() for image in named_images(found)))
    if usable := next(with_images, None):
        others = " and elsewhere" if len(elsewhere) > 1 else ""
        return f"no photographs found here, but cameras in {usable}{others}; give that."
    return _elsewhere(path, elsewhere)


def _elsewhere(folder: Path, cameras: list[Path]) -> str:
    """Return the sentence for a folder without photographs: it names folders below that have some, or cameras.

    cameras: files in folders below, whose images are missing.
    """
    images = (path for depth in ("*/*", "*/*/*", "*/*/*/*") for path in folder.glob(depth) if has_image_name(path))
    found = sorted({path.parent for path in images if not path.parent.name.startswith(".")})
    unread = unread_cameras(folder, set(cameras))
    but = f", but cameras in {unread} are not read: to use them, {CONVERT}" if unread else ""
    if cameras:
        but = f", but cameras in {cameras[0]} name images that are not there: to use them, put the photographs there"
    if not found:
        return f"no photographs and no camera file found; give a folder that holds two or more photographs{but}."
    if len(found) == 1:
        return f"no photographs found here, but in {found[0]}; give that folder{but}."
    return (
        f"no photographs found here, but in {len(found)} folders below; give one of them, as {found[0]}, or put all "
        f"photographs of the scene into one folder{but}."
    )


def _files(folder: Path) -> list[Path]:
    """Return what is in the folder and in its folders `images` and `input`."""
    places = (folder, *(folder / name for name in PHOTOGRAPH_FOLDERS))
    return [path for place in places if place.is_dir() for path in place.iterdir()]
