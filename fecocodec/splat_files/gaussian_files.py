"""Write 3D Gaussians in the format that the ending of the file name selects; `output_formats` lists the formats."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.atomic import write_atomically
from fecocodec.errors import OutputError
from fecocodec.input_file import StrPath
from fecocodec.splat_files.gaussian_arrays import (
    CameraArrays,
    OutputGaussians,
    OutputScene,
    camera_arrays,
    gaussian_arrays,
)
from fecocodec.splat_files.output_formats import Frame, SpzVersion, format_of


def write_gaussians(
    path: StrPath,
    gaussians: OutputGaussians,
    cameras: CameraArrays | None = None,
    *,
    spz_version: SpzVersion = 4,
    overwrite: bool = False,
) -> None:
    """Write Gaussians in the format that the ending of the name selects; another ending gets a PLY.

    cameras: written to .glb and .html; .html needs them.

    Raises OutputError if the format cannot represent the Gaussians or writing fails.
    """
    path = Path(path)
    data = gaussian_bytes(path, gaussians, cameras, spz_version)
    with write_atomically(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(data)


def gaussian_bytes(
    path: Path, gaussians: OutputGaussians, cameras: CameraArrays | None, spz_version: SpzVersion
) -> bytes:
    """Return the bytes of the file that `write_gaussians` writes."""
    file_format = format_of(path)
    if gaussians.count == 0 and not file_format.may_be_empty:
        raise OutputError(f"{path}: there are no Gaussians, which this format cannot hold; write a .ply file.")
    # Loaded on use: SOG needs libraries that the receiver alone does not install.
    writer = import_module(f"{__package__}.{file_format.module}")
    data: bytes = writer.file_bytes(OutputScene(gaussians, cameras, path.stem, str(path), spz_version))
    return data


def decoded_file(
    decoded: Any, path: Path, *, frame: Frame = "input", spz_version: SpzVersion = 4
) -> tuple[bytes, CameraArrays]:
    """Return the bytes of the file `path` of a decoded scene (`fecocodec.Decoded`), and the cameras in its frame.

    frame: that of the input cameras, or that of the first camera. Raises OutputError as `write_gaussians` does.
    """
    gaussians = gaussian_arrays(decoded.gaussians, str(path))
    cameras = camera_arrays(decoded.cameras, decoded.image_size)
    if frame == "first-camera":
        gaussians, cameras = in_frame_of_first_camera(gaussians, cameras)
    return gaussian_bytes(path, gaussians, cameras, spz_version), cameras


def in_frame_of_first_camera(gaussians: OutputGaussians, cameras: CameraArrays) -> tuple[OutputGaussians, CameraArrays]:
    """Move the first camera to the origin, with the axes of the world: +X right, +Y down, +Z forward in .ply files."""
    world_to_camera = np.linalg.inv(cameras.extrinsics[0])
    return gaussians.transformed(world_to_camera), cameras.transformed(world_to_camera)
