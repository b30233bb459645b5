"""Write decoded Gaussians as one self-contained HTML page that opens from disk.

The page holds the viewer program (1.0 MB) and the Gaussians as SPZ version 3: 1.5 MB in all for 16,446 Gaussians.
Decoder and model alone would take 10 MB after gzip compression, and seconds to decode. The package has the page
without a scene, which `make web` builds from `web/`.
"""

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.errors import OutputError
from fecocodec.splat_files.gaussian_arrays import CameraArrays, OutputScene
from fecocodec.splat_files.splat_header import read_splat_header
from fecocodec.splat_files.spz import spz_bytes

FOLDER = Path(__file__).parents[1] / "web"
SCENE_PAGE = "scene.html"


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
            "intrinsics": np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]]).tolist(),
        }
        for pose, k in zip(cameras.extrinsics, cameras.intrinsics, strict=True)
    ]
    return {"near": cameras.near, "far": cameras.far, "views": views}
