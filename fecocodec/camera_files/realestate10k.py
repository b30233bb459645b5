"""RealEstate10K camera text (Zhou et al. 2018): one line per frame, after an optional line with the video's URL.

    timestamp fx fy cx cy 0 0 r11 r12 r13 t1 r21 r22 r23 t2 r31 r32 r33 t3

Intrinsics are normalised by image width and height; the 3x4 matrix is world-to-camera in OpenCV axes.
Images are named by their timestamp and are beside the text file, in `images/`, or in a folder named like the text file.
"""

from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from fecocodec.camera_files.image_matching import match_images
from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, photographs_of, require_numbers
from fecocodec.errors import InputError
from fecocodec.input_file import read_text
from fecocodec.photographs.lens import Lens, require_representable

_COLUMNS = 19
_MOST_PRINCIPAL_POINT = 4.0  # image sides; more are pixels
_LONGEST_LINE = 1 << 16  # characters


def find_realestate10k(path: Path) -> Path | None:
    """Return the camera text of a scene folder: the first whose images are there. `path` may be that file."""
    found = [path] if path.is_file() and has_camera_line(path) else realestate10k_files(path)
    return next((text for text in found if len(found) > 1 and _has_image(text)), next(iter(found), None))


def realestate10k_files(folder: Path) -> list[Path]:
    """Return the camera texts of a scene folder, each `.txt` with a line of 19 columns."""
    return [file for file in sorted(folder.glob("[!.]*.txt")) if file.is_file() and has_camera_line(file)]


def read_realestate10k(path: Path) -> PosedPhotographs:
    """Read the camera of every line. A line that is not valid gives a camera with a problem."""
    text = read_text(path, "check the file").splitlines()
    lines = [(number, _words(line)) for number, line in enumerate(text, start=1) if line.strip()]
    if len(lines[0][1]) == 1:  # the video's URL
        lines = lines[1:]
    folders = [path.parent, path.parent / "images", path.with_suffix("")]
    images = match_images(path, [words[0] for _, words in lines], folders)
    cameras = [(f"{path}, line {number}", partial(_photograph, words)) for number, words in lines]
    return PosedPhotographs(path, photographs_of(images, cameras), remarks=images.remarks)


def _photograph(words: list[str], image: Path, place: str) -> PosedPhotograph:
    if len(words) != _COLUMNS:
        raise InputError(f"{place}: {len(words)} columns found, {_COLUMNS} expected; export the cameras again.")
    values = require_numbers(words[1:], (_COLUMNS - 1,), place)
    fx, fy, cx, cy, *reserved = (float(value) for value in values[:6])
    if fx <= 0 or fy <= 0:
        raise InputError(f"{place}: the focal length is not positive; export the cameras again.")
    if max(cx, cy) > _MOST_PRINCIPAL_POINT:
        raise InputError(
            f"{place}: fx, fy, cx, cy are fractions of the image's width and height here, and {fx:g} {fy:g} {cx:g} "
            f"{cy:g} are pixels; divide them by width and height."
        )
    require_representable(_lens(fx, fy, cx, cy, 1, 1), place)
    if any(reserved):
        raise InputError(f"{place}: columns 6 and 7 are not 0 0, and distortion is not defined here; undistort first.")
    world_to_camera = np.eye(4)
    world_to_camera[:3] = values[6:].reshape(3, 4)
    if not np.abs(world_to_camera[:, :3]).max() < 1e6 or abs(np.linalg.det(world_to_camera)) < 1e-12:
        raise InputError(f"{place}: the pose is singular (its axes span no volume); export the cameras again.")
    return PosedPhotograph(
        path=image,
        place=place,
        camera_to_world=np.linalg.inv(world_to_camera),
        lens_for=partial(_lens, fx, fy, cx, cy),
    )


def _lens(fx: float, fy: float, cx: float, cy: float, width: int, height: int) -> Lens:
    return Lens(width, height, fx * width, fy * height, cx * width, cy * height)


def has_camera_line(path: Path) -> bool:
    """Return whether one of the first two lines has 19 columns, most of them numbers. Others need not be read."""
    with path.open(encoding="utf-8", errors="replace") as file:
        lines = [_words(file.readline(_LONGEST_LINE)) for _ in range(2)]
    return any(len(words) == _COLUMNS and sum(map(_is_number, words)) > _COLUMNS / 2 for words in lines)


def _is_number(word: str) -> bool:
    with suppress(ValueError):
        float(word)
        return True
    return False


def _has_image(path: Path) -> bool:
    with suppress(InputError):
        return any(photograph.path.is_file() for photograph in read_realestate10k(path).photographs)
    return False


def _words(line: str) -> list[str]:
    """Return the columns of a line, which spaces or commas separate."""
    words = line.replace(",", " ").split()
    return words if len(words) == _COLUMNS else line.split()
