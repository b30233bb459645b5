"""Write 3D Gaussians and cameras as binary glTF 2.0 with the ratified extension KHR_gaussian_splatting.

Axes are those of glTF (+Y up); a camera looks along its -Z. Scales are linear, opacities in [0, 1], rotations xyzw.
"""

import json
import struct
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.geometry.gaussian_arrays import SH_DEGREE_0
from fecocodec.splat_files.gaussian_arrays import RDF_TO_RUB, CameraArrays, OutputGaussians, OutputScene

_EXTENSION = "KHR_gaussian_splatting"
_FLOAT, _UNSIGNED_BYTE, _ARRAY_BUFFER, _POINTS = 5126, 5121, 34962, 0
_KIND_OF_WIDTH = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def file_bytes(scene: OutputScene) -> bytes:
    """Return the bytes of the file. Cameras of glTF have no principal point: it is taken as the centre of the image."""
    attributes = _attributes(scene.gaussians.transformed(RDF_TO_RUB))
    buffers = [values.tobytes() for values in attributes.values()]  # all are multiples of four bytes long
    offsets = np.cumsum([0, *map(len, buffers)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": offset, "byteLength": len(data), "target": _ARRAY_BUFFER}
        for offset, data in zip(offsets, buffers, strict=False)
    ]
    camera_nodes, lenses = _cameras(scene.cameras) if scene.cameras is not None else ([], [])
    document = {
        "asset": {"version": "2.0", "generator": "FeCoSplat"},
        "extensionsUsed": [_EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": list(range(1 + len(camera_nodes)))}],
        "nodes": [{"name": "gaussians", "mesh": 0}, *camera_nodes],
        "meshes": [{"primitives": [_primitive(list(attributes))]}],
        "accessors": [_accessor(index, name, values) for index, (name, values) in enumerate(attributes.items())],
        "bufferViews": views,
        "buffers": [{"byteLength": offsets[-1]}],
        **({"cameras": lenses} if lenses else {}),
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<2I", offsets[-1], 0x004E4942) + b"".join(buffers)
    return struct.pack("<3I", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _attributes(gaussians: OutputGaussians) -> dict[str, np.ndarray]:
    harmonics = {
        f"{_EXTENSION}:SH_DEGREE_{degree}_COEF_{index}": gaussians.harmonics[:, degree**2 + index]
        for degree in range(gaussians.sh_degree + 1)
        for index in range(2 * degree + 1)
    }
    colour = 0.5 + SH_DEGREE_0 * gaussians.harmonics[:, 0]  # for viewers that show points
    rgba = np.concatenate((colour, gaussians.opacities[:, None]), axis=1)
    rotations = gaussians.rotations / np.linalg.norm(gaussians.rotations, axis=1, keepdims=True)
    floats = {
        "POSITION": gaussians.means,
        f"{_EXTENSION}:ROTATION": rotations[:, [1, 2, 3, 0]],
        f"{_EXTENSION}:SCALE": gaussians.scales,
        f"{_EXTENSION}:OPACITY": gaussians.opacities[:, None],
        **harmonics,
    }
    return {
        "COLOR_0": np.round(rgba * 255).clip(0, 255).astype(np.uint8),
        **{name: values.astype("<f4") for name, values in floats.items()},
    }


def _accessor(index: int, name: str, values: np.ndarray) -> dict[str, Any]:
    is_colour = values.dtype == np.uint8
    accessor: dict[str, Any] = {
        "bufferView": index,
        "componentType": _UNSIGNED_BYTE if is_colour else _FLOAT,
        "count": len(values),
        "type": _KIND_OF_WIDTH[values.shape[1]],
    }
    if is_colour:
        accessor["normalized"] = True
    if name == "POSITION":
        accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
    return accessor


def _primitive(names: list[str]) -> dict[str, Any]:
    extension = {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "sortingMethod": "cameraDistance",
        "projection": "perspective",
    }
    attributes = {name: index for index, name in enumerate(names)}
    return {"attributes": attributes, "mode": _POINTS, "extensions": {_EXTENSION: extension}}


def _cameras(cameras: CameraArrays) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return a node for each camera, and its projection."""
    poses: Float[np.ndarray, "view 4 4"] = RDF_TO_RUB @ cameras.extrinsics @ RDF_TO_RUB
    nodes = [
        {"name": f"camera {index}", "camera": index, "matrix": pose.T.ravel().tolist()}  # glTF: by columns
        for index, pose in enumerate(poses)
    ]
    lenses = [
        {
            "type": "perspective",
            "perspective": {
                "yfov": float(2 * np.arctan(0.5 / matrix[1, 1])),
                "aspectRatio": float(matrix[1, 1] / matrix[0, 0]),
                "znear": cameras.near / 10,
            },
        }
        for matrix in cameras.intrinsics
    ]
    return nodes, lenses
