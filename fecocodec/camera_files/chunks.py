"""Data sets in pixelSplat's chunks: `000000.torch`, `000001.torch`, ... and an `index.json` that maps scenes to chunks.

RealEstate10K and ACID are published in this layout (Charatan et al., "pixelSplat", 2024), and DepthSplat's scripts
write DL3DV in it. A chunk is a list of records `{key, url, timestamps, cameras, images}`, written by `torch.save`. It
is loaded without executing code: only tensors, lists, strings and numbers are accepted.
"""

import zipfile
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fecocodec.camera_files.posed_photographs import require_float32_range, require_numbers, rigid_pose
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views
from fecocodec.input_file import read_json
from fecocodec.limits import require_size
from fecocodec.photographs.images import decode_image
from fecocodec.photographs.lens import Lens
from fecocodec.photographs.resampling import crop_and_resize

VIDEO_BOUNDS = (0.5, 100.0)  # RealEstate10K and ACID
DL3DV_BOUNDS = (0.5, 200.0)
# Of a frame: fx fy cx cy 0 0, normalised by image width and height, and the 3x4 world-to-camera matrix in OpenCV axes,
# row-major. DepthSplat's scripts for DL3DV write the same rows.
_CAMERA_VALUES = 18


@dataclass(frozen=True)
class ChunkScene:
    """Frames of one scene; images are decoded on demand.

    place: file and scene, for messages. bounds: (near, far) in scene units, as the public configurations set them for
    the data set of the scene. extrinsics: camera-to-world, OpenCV axes. intrinsics: normalised by image width and
    height. encoded: bytes of the image files.
    """

    name: str
    place: str
    bounds: tuple[float, float]
    timestamps: tuple[int, ...]
    extrinsics: Float[np.ndarray, "frame 4 4"]
    intrinsics: Float[np.ndarray, "frame 3 3"]
    encoded: tuple[UInt8[Tensor, " _"], ...]

    def __len__(self) -> int:
        return len(self.encoded)

    def image(self, frame: int) -> Float[Tensor, "3 height width"]:
        """Decode the photograph of a frame: sRGB in [0, 1], at its stored size. Raises InputError if it is damaged."""
        return decode_image(self.encoded[frame].numpy().tobytes(), f"{self.place}, image {frame}")

    def views(self, frames: tuple[int, ...], *, size: tuple[int, int]) -> Views:
        """Return these frames in this order, centre-cropped to the shape of `size` = (height, width) and resized.

        Unlike the public loaders, which crop at whole pixels and keep the
        principal point at the centre, images and intrinsics are consistent to fractions of a pixel.
        Raises InputError for a frame that does not exist, or a damaged image.
        """
        require_size(size)
        missing = [frame for frame in frames if not 0 <= frame < len(self)]
        if missing or not frames:
            raise InputError(f"{self.place}: there is no frame {missing or ''}; choose from 0 to {len(self) - 1}.")
        images = [self.image(frame) for frame in frames]
        pinholes = [self.lens(frame, *image.shape[1:]) for frame, image in zip(frames, images, strict=True)]
        framed = [crop_and_resize(image, pinhole, size) for image, pinhole in zip(images, pinholes, strict=True)]
        chosen = list(frames)
        cameras = Cameras.in_float32(self.extrinsics[chosen], np.stack([matrix for _, matrix in framed]), *self.bounds)
        names = tuple(f"{frame}:{self.timestamps[frame]}" for frame in frames)
        return Views(torch.stack([image for image, _ in framed]), cameras, names)

    def lens(self, frame: int, height: int, width: int) -> Lens:
        """Return the pinhole of a frame whose stored image has this size in pixels."""
        (fx, _, cx), (_, fy, cy), _ = self.intrinsics[frame].tolist()
        return Lens(width, height, fx * width, fy * height, cx * width, cy * height)


def chunk_scene(record: object, path: Path) -> ChunkScene:
    """Parse one record of a chunk. Raises InputError, which names file and scene, if it is not valid."""
    if not isinstance(record, dict) or not isinstance(record.get("key"), str):
        raise InputError(f"{path}: a record has no key; these are not chunks as pixelSplat writes them.")
    name = record["key"]
    place = f"{path}, scene {name}"
    encoded, timestamps, cameras = (record.get(entry) for entry in ("images", "timestamps", "cameras"))
    if not isinstance(encoded, list) or not all(_is_encoded(image) for image in encoded):
        raise InputError(f"{place}: `images` is no list of encoded images; convert the data set again.")
    if not isinstance(timestamps, Tensor) or timestamps.shape != (len(encoded),) or timestamps.is_floating_point():
        raise InputError(f"{place}: `timestamps` is not one whole number an image; convert the data set again.")
    if not isinstance(cameras, Tensor):
        raise InputError(f"{place}: `cameras` is no tensor; convert the data set again.")
    values = require_numbers(cameras.double().numpy(), (len(encoded), _CAMERA_VALUES), f"{place}, cameras")
    extrinsics, intrinsics = _cameras(values, place)
    return ChunkScene(
        name=name,
        place=place,
        bounds=VIDEO_BOUNDS if "://" in str(record.get("url")) else DL3DV_BOUNDS,  # only records of videos have a URL
        timestamps=tuple(timestamps.tolist()),
        extrinsics=extrinsics,
        intrinsics=intrinsics,
        encoded=tuple(encoded),
    )


def _is_encoded(image: object) -> bool:
    return isinstance(image, Tensor) and image.dtype == torch.uint8 and image.dim() == 1


def _cameras(
    values: Float[np.ndarray, "frame 18"], place: str
) -> tuple[Float[np.ndarray, "frame 4 4"], Float[np.ndarray, "frame 3 3"]]:
    """Return camera-to-world matrices and normalised intrinsics of every frame."""
    if not (values[:, :2] > 0).all():
        raise InputError(f"{place}: a focal length is not positive; convert the data set again.")
    intrinsics = np.tile(np.eye(3), (len(values), 1, 1))
    intrinsics[:, 0, 0], intrinsics[:, 1, 1] = values[:, 0], values[:, 1]
    intrinsics[:, 0, 2], intrinsics[:, 1, 2] = values[:, 2], values[:, 3]
    world_to_camera = np.tile(np.eye(4), (len(values), 1, 1))
    world_to_camera[:, :3] = values[:, 6:].reshape(-1, 3, 4)
    rigid = [rigid_pose(pose, f"{place}, camera {frame}") for frame, pose in enumerate(world_to_camera)]
    extrinsics = np.linalg.inv(np.stack(rigid)) if rigid else np.zeros((0, 4, 4))
    if rigid:
        require_float32_range(extrinsics, place)
    return extrinsics, intrinsics


INDEX_FILE = "index.json"
_MOST_OPEN = 16  # chunks kept open; they are mapped into memory, not read


def is_chunk_folder(path: Path) -> bool:
    """Return whether a folder has an index and chunks (such as `re10k/test`)."""
    return (path / INDEX_FILE).is_file() and next(path.glob("*.torch"), None) is not None


class ChunkFolder:
    """The scenes of one split of a data set, by name. Chunks are opened on demand."""

    def __init__(self, root: Path) -> None:
        """root: folder with `index.json` and the chunks. Raises InputError if the index is missing or invalid."""
        self.root = root
        self._file_of = _read_index(root / INDEX_FILE)
        self._open: OrderedDict[str, dict[str, object]] = OrderedDict()

    @property
    def scene_names(self) -> tuple[str, ...]:
        """Return the keys of all scenes, in the order of the index."""
        return tuple(self._file_of)

    @cached_property
    def names_by_chunk(self) -> tuple[tuple[str, ...], ...]:
        """Return the keys of the scenes of each chunk, in the order of the index."""
        groups: dict[str, list[str]] = {}
        for name, file in self._file_of.items():
            groups.setdefault(file, []).append(name)
        return tuple(tuple(names) for names in groups.values())

    def scene(self, name: str) -> ChunkScene:
        """Return the scene with this key. Raises InputError if there is none, or its chunk or record is damaged."""
        if name not in self._file_of:
            raise InputError(f"{self.root / INDEX_FILE}: has no scene {name}; check that the index is for this split.")
        file = self._file_of[name]
        records = self._records(file)
        if name not in records:
            raise InputError(
                f"{self.root / file}: has no scene {name}, though {INDEX_FILE} says so; write the index again."
            )
        return chunk_scene(records[name], self.root / file)

    def _records(self, file: str) -> dict[str, object]:
        if file not in self._open:
            self._open[file] = read_chunk(self.root / file)
            if len(self._open) > _MOST_OPEN:
                self._open.popitem(last=False)
        self._open.move_to_end(file)
        return self._open[file]


def read_chunk(path: Path) -> dict[str, object]:
    """Return the records of a chunk by key. Images stay encoded in the memory-mapped file.

    Raises InputError if the file is missing or damaged, or has anything other than plain data.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such chunk; download or convert this part of the data set.")
    if not zipfile.is_zipfile(path):
        raise InputError(f"{path}: this is no chunk as torch.save writes it, or it is cut short; fetch it again.")
    try:
        records = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
    except Exception as error:  # a damaged pickle can raise any exception
        raise InputError(
            f"{path}: the chunk is damaged, or holds more than tensors and text ({type(error).__name__}); "
            "fetch it again."
        ) from error
    if not isinstance(records, list):
        raise InputError(f"{path}: holds no list of scenes; these are not chunks as pixelSplat writes them.")
    return {str(record.get("key")): record for record in records if isinstance(record, dict)}


def _read_index(path: Path) -> dict[str, str]:
    index = read_json(path, "give a folder of chunks with a whole index, such as re10k/test")
    if not isinstance(index, dict) or not index:
        raise InputError(f"{path}: is no object of scene to chunk; write the index again.")
    for scene, file in index.items():
        if not isinstance(file, str) or Path(file).name != file or file in ("", ".", ".."):
            raise InputError(f"{path}: scene {scene} is not in a file beside the index; write the index again.")
    return index
