"""The pages of the viewer: one of decoded Gaussians that opens from disk, and one that decodes `.fcs` files.

The first holds the viewer program (1.0 MB) and the Gaussians as SPZ version 3: 1.5 MB in all for 16,446 Gaussians.
Decoder and model alone would take 10 MB after gzip compression, and seconds to decode. The package has the page
without a scene, which `make web` builds from `web/`.
"""

import base64
import json
import re
import struct
import zlib
from pathlib import Path
from typing import Any

from fecocodec.errors import InputError, OutputError
from fecocodec.splat_files.gaussian_arrays import CameraArrays, OutputScene
from fecocodec.splat_files.spz import spz_bytes

FOLDER = Path(__file__).parents[1] / "web"
SCENE_PAGE = "scene.html"
MAX_BYTES = 384 << 20  # as base64, a longer file would not fit in a string of a browser
_MAX_HEADER_BYTES = 1 << 16
_SPZ_HEADER_BYTES = 12
_SPZ_MAGIC = 0x5053474E
_NEEDED = ({"x", "y", "z", "f_dc_0", "opacity", "scale_0", "rot_0"}, {"packed_position", "packed_scale"})
START = "index.html"


def scene_page(folder: Path = FOLDER) -> bytes:
    """Return the page without a scene. Raises OutputError if it is missing."""
    try:
        return (folder / SCENE_PAGE).read_bytes()
    except OSError as error:
        raise OutputError(
            f"{folder / SCENE_PAGE}: the viewer page is missing; install again, or run `make web` in the clone "
            "(needs Node.js 20)."
        ) from error


def file_bytes(scene: OutputScene) -> bytes:
    """Return the bytes of the page. Raises OutputError if SPZ cannot hold the Gaussians, or the page is missing.

    Gaussians without cameras have no first view, and are refused too.
    """
    gaussians, cameras = scene.gaussians, scene.cameras
    if cameras is None:
        raise OutputError(f"{scene.place}: a page needs cameras to look from; give them, or write another format.")
    height, width = cameras.image_size
    fields = {"width": width, "height": height, "cameras": _cameras(cameras)}
    return _filled(scene.name, gaussians.count, ".spz", spz_bytes(gaussians, scene.place, 3), fields)


def page_of_file(path: Path, data: bytes) -> bytes:
    """Return the bytes of a page that shows a file of Gaussians. The page chooses a first view.

    Raises InputError if the file holds no Gaussians, OutputError if the page is missing.
    """
    kind, count = read_splat_header(path, data)
    return _filled(path.stem, count, kind, data, {"width": 1, "height": 1, "cameras": None})


def _filled(name: str, count: int, kind: str, gaussians: bytes, fields: dict[str, Any]) -> bytes:
    """Return the page with a scene. kind: of the file that `gaussians` holds, .ply or .spz."""
    scene = {"name": name, "count": count, "type": kind.removeprefix("."), **fields}
    parts = {
        b"SCENE": json.dumps(scene).replace("<", "\\u003c").encode("ascii"),
        b"GAUSSIANS": base64.b64encode(gaussians),
    }
    # In one pass: the name of a scene can look like a mark.
    return re.sub(rb"/\*(SCENE|GAUSSIANS)\*/", lambda mark: parts[mark[1]], scene_page())


def _cameras(cameras: CameraArrays) -> dict[str, object]:
    """Return the cameras as the viewer's `StoredCameras`."""
    views = [
        {
            "rotation": pose[:3, :3].flatten().tolist(),
            "centre": pose[:3, 3].tolist(),
            "intrinsics": k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
        }
        for pose, k in zip(cameras.extrinsics, cameras.intrinsics, strict=True)
    ]
    return {"near": cameras.near, "far": cameras.far, "views": views}


def read_splat_header(path: Path, data: bytes) -> tuple[str, int]:
    """Return the kind of a file, .ply or .spz, and the number of its Gaussians.

    Raises InputError if these are no Gaussians, or the viewer page cannot read them.
    """
    kind = path.suffix.lower()
    count = _count_of_spz(path, data) if kind == ".spz" else _count_of_ply(path, data)
    if count == 0:
        raise InputError(f"{path}: the file holds no Gaussians; give one that does.")
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: the page shows files of at most {MAX_BYTES >> 20} MiB; compress it, as .spz.")
    return kind, count


def _count_of_ply(path: Path, data: bytes) -> int:
    """Return the number of Gaussians of a binary PLY, in the layout of 3DGS or of PlayCanvas."""
    head, found, _ = data[:_MAX_HEADER_BYTES].partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    counts = [words[2] for words in lines if words[:2] == ["element", "vertex"] and len(words) == 3]
    names = {words[-1] for words in lines if words[:1] == ["property"]}
    is_binary = ["format", "binary_little_endian", "1.0"] in lines
    if lines[:1] != [["ply"]] or not found or not is_binary or len(counts) != 1 or not counts[0].isdecimal():
        raise InputError(f"{path}: this is no binary PLY file; give a .ply file of 3D Gaussians.")
    if not any(needed <= names for needed in _NEEDED):
        raise InputError(
            f"{path}: its points have no scales, rotations and opacities, so they are no Gaussians; give a .ply file "
            "of 3D Gaussians."
        )
    return int(counts[0])


def _count_of_spz(path: Path, data: bytes) -> int:
    """Return the number of Gaussians of an SPZ file of version 1 to 3, which is compressed with gzip as a whole."""
    if data[:4] == struct.pack("<I", _SPZ_MAGIC):
        raise InputError(f"{path}: the page reads SPZ up to version 3; write it again with `spz_version=3`.")
    try:
        header = zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(data, _SPZ_HEADER_BYTES)
        magic, _, count = struct.unpack("<3I", header)
    except (zlib.error, struct.error) as error:
        raise InputError(f"{path}: this is no SPZ file; give an .spz file of 3D Gaussians.") from error
    if magic != _SPZ_MAGIC:
        raise InputError(f"{path}: this is no SPZ file; give an .spz file of 3D Gaussians.")
    return int(count)


def decoding_page(folder: Path = FOLDER) -> dict[str, bytes]:
    """Return the contents of the page's files by their path in its folder. Raises OutputError if it was not built."""
    if not (folder / START).is_file():
        raise OutputError(
            f"{folder / START}: the page that decodes in the browser was not built; run `make web` in the clone (needs "
            "Node.js 20), and install it again."
        )
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != SCENE_PAGE)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
