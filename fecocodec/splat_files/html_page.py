"""Write decoded Gaussians as one self-contained HTML page that opens from disk.

The page holds the viewer program (1.4 MB) and the Gaussians as SPZ version 3: 1.8 MB in all for 16,203 Gaussians.
Decoder and model alone would take 10 MB after gzip compression, and seconds to decode.
"""

import base64
import json

import numpy as np

from fecocodec.splat_files.gaussian_arrays import CameraArrays, OutputGaussians
from fecocodec.splat_files.spz import spz_bytes
from fecocodec.splat_files.viewer_files import scene_page


def html_page_bytes(gaussians: OutputGaussians, cameras: CameraArrays, name: str, place: str) -> bytes:
    """Return the bytes of the page. name: of the scene, shown in the page.

    Raises OutputError, which begins with `place`, if SPZ cannot hold the Gaussians, or if the viewer was not built.
    """
    height, width = cameras.image_size
    scene = {"name": name, "count": gaussians.count, "width": width, "height": height, "cameras": _cameras(cameras)}
    parts = {
        b"/*SCENE*/": json.dumps(scene).replace("<", "\\u003c").encode("ascii"),
        b"/*GAUSSIANS*/": base64.b64encode(spz_bytes(gaussians, place, 3)),
    }
    page = scene_page()
    for mark, content in parts.items():
        page = page.replace(mark, content, 1)
    return page


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
