"""COLMAP's text tables: cameras.txt, images.txt, points3D.txt; lines that begin with # are comments."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fecocodec.camera_files.colmap_model import ColmapCamera, ColmapImage, ColmapModel
from fecocodec.errors import InputError
from fecocodec.input_file import read_text


def read_text_model(folder: Path) -> ColmapModel:
    """Read the tables in `folder`. Raises InputError, with file and line, if one is invalid."""
    points = folder / "points3D.txt"
    return ColmapModel(
        cameras=dict(_camera(words, place) for words, place in _lines(folder / "cameras.txt") if words),
        images=list(_images(folder / "images.txt")),
        points=dict(_point(words, place) for words, place in _lines(points) if words) if points.is_file() else {},
    )


def _camera(words: list[str], place: str) -> tuple[int, ColmapCamera]:
    try:
        width, height, *parameters = (float(word) for word in words[2:])
        return int(words[0]), ColmapCamera(words[1], int(width), int(height), tuple(parameters))
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(f"{place}: no camera `ID MODEL WIDTH HEIGHT PARAMETERS`; export the model again.") from error


def _images(path: Path) -> Iterator[ColmapImage]:
    """Yield images. Each has two lines: pose and name, then observations, which may be an empty line."""
    lines = _lines(path)
    for words, place in lines:
        if not words:
            continue
        observations, _ = next(lines, ([], place))
        try:
            yield ColmapImage(
                name=" ".join(words[9:]),
                camera_id=int(words[8]),
                rotation=np.array(words[1:5], dtype=np.float64),
                translation=np.array(words[5:8], dtype=np.float64),
                point_ids=np.array(observations[2::3], dtype=np.int64),
            )
        except (ValueError, IndexError, OverflowError) as error:  # ids beyond 63 bits overflow
            raise InputError(
                f"{place}: no image `ID QW QX QY QZ TX TY TZ CAMERA NAME` with points below; export the model again."
            ) from error


def _point(words: list[str], place: str) -> tuple[int, tuple[float, float, float]]:
    try:
        x, y, z = (float(word) for word in words[1:4])
        return int(words[0]), (x, y, z)
    except ValueError as error:
        raise InputError(f"{place}: no point `ID X Y Z ...`; export the model again.") from error


def _lines(path: Path) -> Iterator[tuple[list[str], str]]:
    """Yield the words of each line that is not a comment, with file and line number for messages."""
    text = read_text(path, "export the COLMAP model again")
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.startswith("#"):
            yield line.split(), f"{path}, line {number}"
