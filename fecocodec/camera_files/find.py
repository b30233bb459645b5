"""Find and read the cameras of a scene folder, in any supported format."""

from pathlib import Path

from fecocodec.camera_files.colmap import find_colmap_model, read_colmap
from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.camera_files.realestate10k import find_realestate10k, read_realestate10k
from fecocodec.camera_files.transforms_json import find_transforms_json, read_transforms_json
from fecocodec.errors import InputError
from fecocodec.input_file import StrPath
from fecocodec.photographs.image_headers import IMAGE_SUFFIXES, conversion_advice, has_image_name, is_unread
from fecocodec.photographs.video_frames import is_video
from fecocodec.poses.unposed_photographs import find_photographs


def read_cameras(path: StrPath) -> PosedPhotographs:
    """Read the cameras of a scene folder or of a camera file, in the first format found.

    Images are not read. Raises InputError if there are no cameras or they cannot be read.
    """
    path = Path(path)
    try:
        scene = _find_cameras(path)
        problem = _missing(path) if scene is None else ""
    except (OSError, ValueError) as error:  # ValueError: an invalid file name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read ({reason}); check the path and its permissions.") from error
    if scene is None:
        raise InputError(f"{path}: {problem}")
    return scene


def _missing(path: Path) -> str:
    """Return why an existing path gives no cameras, and what to do."""
    if not path.is_dir():
        if path.suffix.lower() in IMAGE_SUFFIXES:
            return "a photograph, not a camera file; give a folder of two or more photographs, or a camera file."
        return "not a camera file; give the folder that holds images and cameras."
    if not _has_images(path):
        if unread := [file for file in _files(path) if is_unread(file)]:
            kinds = ", ".join(sorted({file.suffix.lower() for file in unread}))
            return f"photographs of this kind cannot be read ({kinds}); {conversion_advice(unread)}."
        if videos := sorted(file for file in _files(path) if is_video(file)):
            return f"no photographs found, but a video; give the file itself, {videos[0]}."
        if scenes := [folder for folder in sorted(path.iterdir()) if folder.is_dir() and _camera_file(folder)]:
            return f"no photographs found, but {len(scenes)} folders with cameras; give one of them, as {scenes[0]}."
        return "no photographs and no camera file found; give a folder that holds two or more photographs."
    return "no cameras found; add a transforms.json, a COLMAP model in sparse/0 or a RealEstate10K camera file."


def _has_images(folder: Path) -> bool:
    """Return whether the folder or its folder `images` holds a file with the name of an image."""
    return any(has_image_name(path) for path in _files(folder))


def _files(folder: Path) -> list[Path]:
    """Return what is in the folder and in its folder `images`."""
    return [path for place in (folder, folder / "images") if place.is_dir() for path in place.iterdir()]


def has_cameras(path: StrPath) -> bool:
    """Return whether there is a camera file, or nothing from which cameras could be estimated.

    Photographs without a camera file are the only case for which the answer is no.
    """
    path = Path(path)
    try:
        is_known = any(find(path) for find in (find_transforms_json, find_colmap_model, find_realestate10k))
        return is_known or not find_photographs(path)
    except (OSError, ValueError):  # `read_cameras` reports it
        return True


def cameras_above(folder: Path) -> Path | None:
    """Return the camera file in the parent of a folder of photographs, None if there is none.

    Raises InputError or OSError if the parent cannot be read.
    """
    return _camera_file(folder.absolute().parent)


def _camera_file(folder: Path) -> Path | None:
    return find_transforms_json(folder) or find_colmap_model(folder)


def _find_cameras(path: Path) -> PosedPhotographs | None:
    if not path.exists():
        raise InputError(f"{path}: no such folder; give the folder that holds images and cameras.")
    if transforms := find_transforms_json(path):
        return read_transforms_json(transforms)
    if model := find_colmap_model(path):
        return read_colmap(path, model)
    if camera_text := find_realestate10k(path):
        return read_realestate10k(camera_text)
    return None
