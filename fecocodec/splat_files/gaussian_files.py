"""Write 3D Gaussians in the format that the ending of the file name selects."""

from pathlib import Path

import numpy as np

from fecocodec.atomic import write_atomically
from fecocodec.errors import OutputError
from fecocodec.input_file import StrPath
from fecocodec.splat_files.compressed_ply import compressed_ply_bytes
from fecocodec.splat_files.gaussian_arrays import CameraArrays, OutputGaussians
from fecocodec.splat_files.glb import glb_bytes
from fecocodec.splat_files.html_page import html_page_bytes
from fecocodec.splat_files.ply_writing import ply_bytes
from fecocodec.splat_files.spz import SpzVersion, spz_bytes


def write_gaussians(
    path: StrPath,
    gaussians: OutputGaussians,
    cameras: CameraArrays | None = None,
    *,
    spz_version: SpzVersion = 4,
    overwrite: bool = False,
) -> None:
    """Write Gaussians as .ply, .compressed.ply, .spz, .sog, .glb or .html; another ending gets a PLY.

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
    name = path.name.lower()
    is_compressed = name.endswith((".compressed.ply", ".spz", ".sog", ".glb", ".html"))
    if is_compressed and gaussians.count == 0:
        raise OutputError(f"{path}: there are no Gaussians, which this format cannot hold; write a .ply file.")
    if name.endswith(".compressed.ply"):
        return compressed_ply_bytes(gaussians)
    if name.endswith(".spz"):
        return spz_bytes(gaussians, str(path), spz_version)
    if name.endswith(".sog"):
        from fecocodec.splat_files.sog import sog_bytes  # needs libraries that the receiver alone does not install

        return sog_bytes(gaussians)
    if name.endswith(".html") and cameras is not None:
        return html_page_bytes(gaussians, cameras, path.stem, str(path))
    return glb_bytes(gaussians, cameras) if name.endswith(".glb") else ply_bytes(gaussians, str(path))


def in_frame_of_first_camera(gaussians: OutputGaussians, cameras: CameraArrays) -> tuple[OutputGaussians, CameraArrays]:
    """Move the first camera to the origin, with the axes of the world: +X right, +Y down, +Z forward in .ply files."""
    world_to_camera = np.linalg.inv(cameras.extrinsics[0])
    return gaussians.transformed(world_to_camera), cameras.transformed(world_to_camera)
