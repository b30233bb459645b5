"""One scene of a chunk: encoded photographs and 18 camera values per frame, in the layout of pixelSplat.

A row of `cameras` is fx fy cx cy 0 0 and the 3x4 world-to-camera matrix in OpenCV axes, row-major. Intrinsics are
normalised by image width and height. DepthSplat's scripts for DL3DV write the same rows.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fecocodec.camera_files.pose_validation import require_float32_range, rigid_pose
from fecocodec.camera_files.posed_photographs import require_numbers
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views
from fecocodec.photographs.framing import require_size
from fecocodec.photographs.images import decode_image
from fecocodec.photographs.lens import Lens
from fecocodec.photographs.resampling import crop_and_resize

VIDEO_BOUNDS = (0.5, 100.0)  # RealEstate10K and ACID
DL3DV_BOUNDS = (0.5, 200.0)
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

    def views(
        self, frames: tuple[int, ...], *, size: tuple[int, int], near: float | None = None, far: float | None = None
    ) -> Views:
        """Return these frames in this order, centre-cropped to the shape of `size` = (height, width) and resized.

        near, far: in scene units; default `bounds`. Unlike the public loaders, which crop at whole pixels and keep the
        principal point at the centre, images and intrinsics are consistent to fractions of a pixel.
        Raises InputError for a frame that does not exist, a damaged image, or invalid depth bounds.
        """
        require_size(size)
        missing = [frame for frame in frames if not 0 <= frame < len(self)]
        if missing or not frames:
            raise InputError(f"{self.place}: there is no frame {missing or ''}; choose from 0 to {len(self) - 1}.")
        near, far = self.bounds[0] if near is None else near, self.bounds[1] if far is None else far
        if not 0 < near < far:
            raise InputError(f"{self.place}: near {near:.6g} and far {far:.6g} are no range; give 0 < near < far.")
        images = [self.image(frame) for frame in frames]
        pinholes = [self.lens(frame, *image.shape[1:]) for frame, image in zip(frames, images, strict=True)]
        framed = [crop_and_resize(image, pinhole, size) for image, pinhole in zip(images, pinholes, strict=True)]
        chosen = list(frames)
        cameras = Cameras(
            extrinsics=torch.from_numpy(self.extrinsics[chosen].astype(np.float32)),
            intrinsics=torch.from_numpy(np.stack([matrix for _, matrix in framed]).astype(np.float32)),
            near=torch.tensor(near, dtype=torch.float32),
            far=torch.tensor(far, dtype=torch.float32),
        )
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
