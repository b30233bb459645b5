"""The tables of a COLMAP sparse model: cameras, images and points3D.

Binary tables are little-endian and packed, and each begins with a count. In text tables, lines that begin with # are
comments.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fecocodec.errors import InputError
from fecocodec.input_file import read_file

# COLMAP's model ids and the number of parameters of each, from its sensor/models.h.
_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
    17: ("EQUIRECTANGULAR", 2),
}
_OBSERVATION = np.dtype([("xy", "<f8", 2), ("point_id", "<i8")])
_LEAST_WORDS = 9  # of an image without name in images.txt
_LEAST_IMAGE_BYTES = 73  # of an image without name and observations in images.bin


@dataclass(frozen=True)
class ColmapCamera:
    """A camera. model: COLMAP's name, such as OPENCV. parameters: in pixels, in COLMAP's order for this model."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """An image. rotation (quaternion wxyz), translation: world-to-camera, OpenCV axes. point_ids: -1 for no point."""

    name: str
    camera_id: int
    rotation: Float[np.ndarray, "4"]
    translation: Float[np.ndarray, "3"]
    point_ids: Int[np.ndarray, " observation"]


@dataclass(frozen=True)
class ColmapModel:
    """Cameras by id, images in stored order, positions of points by id (empty if the model has no points table)."""

    cameras: dict[int, ColmapCamera]
    images: list[ColmapImage]
    points: dict[int, tuple[float, float, float]]


def is_colmap_model(folder: Path) -> bool:
    """Return whether a folder has the tables of a model; `images.txt` alone may be a list of names."""
    if _is_binary(folder):
        return True
    text = folder / "images.txt"
    return text.is_file() and ((folder / "cameras.txt").is_file() or _is_table(text))


def count_images(folder: Path) -> int:
    """Return the number of registered images, without parsing them."""
    if not _is_binary(folder):
        return sum(1 for _ in _image_lines(folder / "images.txt"))
    path = folder / "images.bin"
    with path.open("rb") as file:
        return min(int.from_bytes(file.read(8), "little"), path.stat().st_size // _LEAST_IMAGE_BYTES)


def read_model(folder: Path) -> ColmapModel:
    """Read the tables in `folder`. Raises InputError, with file and offset or line, if one is cut short or invalid."""
    kind = ".bin" if _is_binary(folder) else ".txt"
    cameras, images, points = (folder / f"{name}{kind}" for name in ("cameras", "images", "points3D"))
    if kind == ".txt":
        return ColmapModel(
            cameras=dict(_camera(words, place) for words, place in _words(cameras) if words),
            images=list(_text_images(images)),
            points=dict(_point(words, place) for words, place in _words(points) if words) if points.is_file() else {},
        )
    return ColmapModel(
        cameras=_binary_cameras(_Table(cameras)),
        images=list(_binary_images(_Table(images))),
        points=_binary_points(_Table(points)) if points.is_file() else {},
    )


class _Table:
    """Reads values in sequence and tracks the byte offset for messages."""

    def __init__(self, path: Path) -> None:
        self.path, self.offset = path, 0
        self.data = read_file(path, "export the COLMAP model again")

    def take(self, layout: str) -> tuple[int | float, ...]:
        start = self.skip(struct.calcsize("<" + layout))
        return struct.unpack_from("<" + layout, self.data, start)

    def count(self) -> int:
        return int(self.take("Q")[0])

    def skip(self, num_bytes: int) -> int:
        """Advance by `num_bytes` and return the previous offset. Raises InputError if the file is too short."""
        start = self.offset
        if num_bytes > len(self.data) - start:
            raise InputError(f"{self.path}, offset {start}: the file is cut short; export the COLMAP model again.")
        self.offset += num_bytes
        return start

    def text(self) -> str:
        end = self.data.find(b"\0", self.offset)
        start = self.skip((end if end >= 0 else len(self.data)) + 1 - self.offset)
        return self.data[start : self.offset - 1].decode("utf-8", "surrogateescape")  # as names of files


def _is_table(path: Path) -> bool:
    with path.open(encoding="utf-8", errors="replace") as file:
        lines = (line.split() for line in file if not line.startswith("#"))
        return len(next((words for words in lines if words), [])) >= _LEAST_WORDS


def _is_binary(folder: Path) -> bool:
    return (folder / "images.bin").is_file()


def _binary_cameras(table: _Table) -> dict[int, ColmapCamera]:
    cameras = {}
    for _ in range(table.count()):
        camera_id, model_id, width, height = (int(value) for value in table.take("iiQQ"))
        if model_id not in _MODELS:
            raise InputError(f"{table.path}: unknown camera model {model_id}; undistort the images with COLMAP first.")
        model, num_parameters = _MODELS[model_id]
        cameras[camera_id] = ColmapCamera(model, width, height, table.take(f"{num_parameters}d"))
    return cameras


def _binary_images(table: _Table) -> list[ColmapImage]:
    images = []
    for _ in range(table.count()):
        _, *pose, camera_id = table.take("i7di")
        name, num_observations = table.text(), table.count()
        start = table.skip(num_observations * _OBSERVATION.itemsize)
        observations = np.frombuffer(table.data, _OBSERVATION, num_observations, start)
        rotation, translation = np.array(pose[:4]), np.array(pose[4:])
        images.append(ColmapImage(name, int(camera_id), rotation, translation, observations["point_id"]))
    return images


def _binary_points(table: _Table) -> dict[int, tuple[float, float, float]]:
    points = {}
    for _ in range(table.count()):
        point_id, x, y, z = table.take("Q3d")
        table.skip(3 + 8)  # colour, reprojection error
        table.skip(8 * table.count())  # the track: image id and observation index
        points[int(point_id)] = (x, y, z)
    return points


def _camera(words: list[str], place: str) -> tuple[int, ColmapCamera]:
    try:
        width, height, *parameters = (float(word) for word in words[2:])
        return int(words[0]), ColmapCamera(words[1], int(width), int(height), tuple(parameters))
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(f"{place}: no camera `ID MODEL WIDTH HEIGHT PARAMETERS`; export the model again.") from error


def _text_images(path: Path) -> Iterator[ColmapImage]:
    """Yield images. The name is the rest of the line, and may have spaces."""
    for line, place, observations in _image_lines(path):
        words = line.split(maxsplit=9)
        try:
            yield ColmapImage(
                name=words[9].rstrip() if len(words) > 9 else "",
                camera_id=int(words[8]),
                rotation=np.array(words[1:5], dtype=np.float64),
                translation=np.array(words[5:8], dtype=np.float64),
                point_ids=np.array(observations.split()[2::3], dtype=np.int64),
            )
        except (ValueError, IndexError, OverflowError) as error:  # ids beyond 63 bits overflow
            cause = ", and it has commas, which must be spaces or points" if "," in " ".join(words[:9]) else ""
            raise InputError(
                f"{place}: no image `ID QW QX QY QZ TX TY TZ CAMERA NAME` with points below{cause}; export the model "
                "again."
            ) from error


def _image_lines(path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield the two lines of each image, with the place of the first: pose and name, then observations, even none."""
    lines = _lines(path)
    for line, place in lines:
        if line.strip():
            observations, _ = next(lines, ("", place))
            yield line, place, observations


def _point(words: list[str], place: str) -> tuple[int, tuple[float, float, float]]:
    try:
        x, y, z = (float(word) for word in words[1:4])
        return int(words[0]), (x, y, z)
    except ValueError as error:
        raise InputError(f"{place}: no point `ID X Y Z ...`; export the model again.") from error


def _words(path: Path) -> Iterator[tuple[list[str], str]]:
    return ((line.split(), place) for line, place in _lines(path))


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Yield each line that is not a comment, with file and line number for messages."""
    data = read_file(path, "export the COLMAP model again")
    text = data.decode("utf-8-sig", "surrogateescape")  # as above
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.startswith("#"):
            yield line, f"{path}, line {number}"
