"""Write cameras as JSON: `transforms.json` of nerfstudio, and `cameras.json` of the 3DGS reference implementation."""

import json
from pathlib import Path
from typing import Any

from fecocodec.atomic import write_file
from fecocodec.input_file import StrPath
from fecocodec.splat_files.gaussian_arrays import RDF_TO_RUB, CameraArrays

REFERENCE_NAME = "cameras.json"  # a file of this name has the layout of the 3DGS reference


def write_camera_json(path: StrPath, cameras: CameraArrays, names: list[str], *, overwrite: bool = False) -> None:
    """Write cameras in the frame of the PLY file. names: of the images, one per camera.

    The layout is that of the 3DGS reference for a file called `cameras.json`, else that of nerfstudio, with `near` and
    `far` in scene units. Raises OutputError if the file cannot be written.
    """
    path = Path(path)
    layout = _reference_layout if path.name.lower() == REFERENCE_NAME else _nerfstudio_layout
    write_file(path, json.dumps(layout(cameras, names), indent=2) + "\n", overwrite=overwrite)


def _nerfstudio_layout(cameras: CameraArrays, names: list[str]) -> dict[str, Any]:
    """Return camera-to-world poses in OpenGL axes and intrinsics in pixels."""
    height, width = cameras.image_size
    frames = [
        {
            "file_path": name,
            "w": width,
            "h": height,
            "fl_x": float(intrinsics[0, 0] * width),
            "fl_y": float(intrinsics[1, 1] * height),
            "cx": float(intrinsics[0, 2] * width),
            "cy": float(intrinsics[1, 2] * height),
            "transform_matrix": (pose @ RDF_TO_RUB).tolist(),
        }
        for name, pose, intrinsics in zip(names, cameras.extrinsics, cameras.intrinsics, strict=True)
    ]
    return {"camera_model": "PINHOLE", "near": cameras.near, "far": cameras.far, "frames": frames}


def _reference_layout(cameras: CameraArrays, names: list[str]) -> list[dict[str, Any]]:
    """Return camera-to-world rotations in OpenCV axes, positions, and focal lengths in pixels (`camera_to_JSON`)."""
    height, width = cameras.image_size
    return [
        {
            "id": index,
            "img_name": name,
            "width": width,
            "height": height,
            "position": pose[:3, 3].tolist(),
            "rotation": pose[:3, :3].tolist(),
            "fy": float(intrinsics[1, 1] * height),
            "fx": float(intrinsics[0, 0] * width),
        }
        for index, (name, pose, intrinsics) in enumerate(
            zip(names, cameras.extrinsics, cameras.intrinsics, strict=True)
        )
    ]
