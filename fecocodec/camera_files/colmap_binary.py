"""COLMAP's binary tables: cameras.bin, images.bin, points3D.bin; little-endian, packed, each begins with a count."""

import struct
from pathlib import Path

import numpy as np

from fecocodec.camera_files.colmap_model import ColmapCamera, ColmapImage, ColmapModel
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
}
_OBSERVATION = np.dtype([("xy", "<f8", 2), ("point_id", "<i8")])


def read_binary_model(folder: Path) -> ColmapModel:
    """Read the tables in `folder`. Raises InputError, with file and byte offset, if one is truncated or invalid."""
    points = folder / "points3D.bin"
    return ColmapModel(
        cameras=_cameras(_Table(folder / "cameras.bin")),
        images=_images(_Table(folder / "images.bin")),
        points=_points(_Table(points)) if points.is_file() else {},
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
        return self.data[start : self.offset - 1].decode("utf-8", "replace")


def _cameras(table: _Table) -> dict[int, ColmapCamera]:
    cameras = {}
    for _ in range(table.count()):
        camera_id, model_id, width, height = (int(value) for value in table.take("iiQQ"))
        if model_id not in _MODELS:
            raise InputError(f"{table.path}: unknown camera model {model_id}; undistort the images with COLMAP first.")
        model, num_parameters = _MODELS[model_id]
        cameras[camera_id] = ColmapCamera(model, width, height, table.take(f"{num_parameters}d"))
    return cameras


def _images(table: _Table) -> list[ColmapImage]:
    images = []
    for _ in range(table.count()):
        _, *pose, camera_id = table.take("i7di")
        name, num_observations = table.text(), table.count()
        start = table.skip(num_observations * _OBSERVATION.itemsize)
        observations = np.frombuffer(table.data, _OBSERVATION, num_observations, start)
        rotation, translation = np.array(pose[:4]), np.array(pose[4:])
        images.append(ColmapImage(name, int(camera_id), rotation, translation, observations["point_id"]))
    return images


def _points(table: _Table) -> dict[int, tuple[float, float, float]]:
    points = {}
    for _ in range(table.count()):
        point_id, x, y, z = table.take("Q3d")
        table.skip(3 + 8)  # colour, reprojection error
        table.skip(8 * table.count())  # the track: image id and observation index
        points[int(point_id)] = (x, y, z)
    return points
