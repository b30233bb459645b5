"""Write 3D Gaussians in the format that the ending of the file name selects; `output_formats` lists the formats."""

from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fecocodec.atomic import write_file
from fecocodec.errors import OutputError
from fecocodec.geometry.upright import to_upright_frame, vertical
from fecocodec.input_file import StrPath
from fecocodec.splat_files.gaussian_arrays import (
    CameraArrays,
    OutputGaussians,
    OutputScene,
    camera_arrays,
    gaussian_arrays,
)
from fecocodec.splat_files.output_formats import Frame, SpzVersion, format_of

NO_VERTICAL = "the cameras do not agree on which way is up, so the up direction of the first one is taken."


def write_gaussians(
    path: StrPath,
    gaussians: OutputGaussians,
    cameras: CameraArrays | None = None,
    *,
    sh_degree: int | None = None,
    spz_version: SpzVersion = 3,
    overwrite: bool = False,
) -> None:
    """Write Gaussians in the format that the ending of the name selects; another ending gets a PLY.

    cameras: written to .glb and .html; .html needs them. sh_degree: least degree of the harmonics in the file, with
    zeros above that of the Gaussians; None for the degree of the format (3 for .ply, else that of the Gaussians).

    Raises OutputError if the format cannot represent the Gaussians or writing fails.
    """
    path = Path(path)
    data = gaussian_bytes(path, gaussians, cameras, sh_degree, spz_version)
    write_file(path, data, overwrite=overwrite)


def gaussian_bytes(
    path: Path,
    gaussians: OutputGaussians,
    cameras: CameraArrays | None,
    sh_degree: int | None,
    spz_version: SpzVersion,
) -> bytes:
    """Return the bytes of the file that `write_gaussians` writes."""
    file_format = format_of(path)
    if gaussians.count == 0 and not file_format.may_be_empty:
        raise OutputError(f"{path}: there are no Gaussians, which this format cannot hold; write a .ply file.")
    gaussians = gaussians.padded(file_format.sh_degree if sh_degree is None else sh_degree)
    data: bytes = writer_of(path).file_bytes(OutputScene(gaussians, cameras, path.stem, str(path), spz_version))
    return data


def writer_of(path: Path) -> Any:
    """Return the module that writes the format of a file, loaded on use. Raises OutputError if its library is missing.

    SOG needs libraries that the receiver alone does not install.
    """
    file_format = format_of(path)
    try:
        return import_module(f"{__package__}.{file_format.module}")
    except ModuleNotFoundError as error:
        library = {"PIL": "pillow"}.get(error.name or "", str(error.name))
        needed = "pillow and scipy" if library in ("pillow", "scipy") else library
        raise OutputError(
            f"{path}: {file_format.ending} files need {needed}, and {library} is not installed; run pip install "
            f"{needed.replace(' and ', ' ')}."
        ) from error


class DecodedFile(NamedTuple):
    """What `decoded_file` makes. cameras: in the frame that was asked for, else in that of the input cameras.

    note: one sentence if the file should stand upright and the cameras do not show which way is up, else None.
    """

    data: bytes
    cameras: CameraArrays
    note: str | None


def decoded_file(
    decoded: Any, path: Path, *, frame: Frame | None = None, sh_degree: int | None = None, spz_version: SpzVersion = 3
) -> DecodedFile:
    """Return the bytes of the file `path` of a decoded scene (`fecocodec.Decoded`), and its cameras.

    frame: that of the input cameras, that of the first camera, or the upright one; None for that of the format, which
    the returned cameras do not follow. Other arguments and errors are those of `write_gaussians`.
    """
    gaussians = gaussian_arrays(decoded.gaussians, str(path))
    cameras = camera_arrays(decoded.cameras, decoded.image_size)
    moved_gaussians, moved_cameras, note = in_frame(frame or format_of(path).frame, gaussians, cameras)
    data = gaussian_bytes(path, moved_gaussians, moved_cameras, sh_degree, spz_version)
    return DecodedFile(data, cameras if frame is None else moved_cameras, note)


def in_frame(
    frame: Frame, gaussians: OutputGaussians, cameras: CameraArrays
) -> tuple[OutputGaussians, CameraArrays, str | None]:
    """Move a scene to a frame; returns it, and a note if the cameras do not show which way is up, else None.

    first-camera: the first camera is at the origin, with the axes of the world: +X right, +Y down, +Z forward in .ply
    files. upright: so are the vertical and, levelled, the first camera.
    """
    if frame == "input":
        return gaussians, cameras, None
    pose, note = np.linalg.inv(cameras.extrinsics[0]), None
    if frame == "upright":
        up, is_agreed = vertical(cameras.extrinsics)
        pose, note = to_upright_frame(cameras.extrinsics, up), None if is_agreed else NO_VERTICAL
    return gaussians.transformed(pose), cameras.transformed(pose), note
