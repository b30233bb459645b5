"""A painted wall seen by posed cameras, written to disk in every camera format.

The colour of any ray is known in closed form, so what the readers return can be checked pixel by pixel against the
cameras they return: a wrong axis, crop, focal length or distortion shows as a wrong colour.
"""

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

WALL = np.array([0.2, -0.1, 1.0, -4.0])  # x, y, z with WALL @ (x, y, z, 1) = 0
COLMAP_IDS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4, "OPENCV_FISHEYE": 5} | {
    **{"FULL_OPENCV": 6, "THIN_PRISM_FISHEYE": 10, "SIMPLE_RADIAL_FISHEYE": 8, "RADIAL_FISHEYE": 9},
    **{"SIMPLE_FISHEYE": 14, "FISHEYE": 15},
}
COLMAP_COEFFICIENTS = {
    "SIMPLE_RADIAL": ["k1"],
    "RADIAL": ["k1", "k2"],
    "OPENCV": ["k1", "k2", "p1", "p2"],
    "FULL_OPENCV": ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
    "OPENCV_FISHEYE": ["k1", "k2", "k3", "k4"],
    "SIMPLE_RADIAL_FISHEYE": ["k1"],
    "RADIAL_FISHEYE": ["k1", "k2"],
}


@dataclass(frozen=True)
class Shot:
    """One photograph to be taken: pixels with centres at i + 0.5, pose camera-to-world in OpenCV axes."""

    name: str
    camera_to_world: np.ndarray
    width: int = 96
    height: int = 80
    fx: float = 100.0
    fy: float = 104.0
    cx: float = 47.0
    cy: float = 41.5
    distortion: dict[str, float] = field(default_factory=dict)  # k1 to k6, p1 p2
    model: str = "OPENCV"  # or FULL_OPENCV, or OPENCV_FISHEYE


def shots(count: int = 3, **lens) -> list[Shot]:
    poses = []
    for index in range(count):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", [4 * index - 3, 6 - 5 * index, 2 * index], degrees=True).as_matrix()
        pose[:3, 3] = (0.5 * index - 0.4, 0.1 * index, 0.05 * index)
        poses.append(pose)
    return [Shot(f"{index:03d}.png", pose, **lens) for index, pose in enumerate(poses)]


def wall_colour(origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """sRGB where rays from `origin` [3] along `directions` [... 3] (world axes) meet the wall."""
    distance = -(WALL[:3] @ origin + WALL[3]) / (directions @ WALL[:3])
    x, y, _ = np.moveaxis(origin + directions * distance[..., None], -1, 0)
    waves = ((3.1, 1.7, 0.3), (-2.3, 4.9, 1.1), (6.7, 2.9, 2.0), (1.3, -7.1, 0.7), (5.3, 5.9, 1.9))
    pattern = [sum(np.sin(a * x + b * y + c + 0.9 * channel) for a, b, c in waves) for channel in range(3)]
    return 0.5 + 0.09 * np.stack(pattern, axis=-1)


def wall_depth(camera_to_world: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Depth at which rays [... 3] in camera axes with z = 1 meet the wall."""
    origin = camera_to_world[:3, 3]
    return -(WALL[:3] @ origin + WALL[3]) / (rays @ camera_to_world[:3, :3].T @ WALL[:3])


_taken: dict[str, np.ndarray] = {}


def take(shot: Shot) -> np.ndarray:
    """The photograph, sRGB in [0, 1]."""
    key = repr(replace(shot, name="", camera_to_world=shot.camera_to_world.tolist()))
    if key not in _taken:
        _taken[key] = _take(shot)
    return _taken[key].copy()


def _take(shot: Shot) -> np.ndarray:
    """For each pixel, find the ray that the lens bends onto it by Newton's method."""
    v, u = np.meshgrid(np.arange(shot.height) + 0.5, np.arange(shot.width) + 0.5, indexing="ij")
    seen = np.stack(((u - shot.cx) / shot.fx, (v - shot.cy) / shot.fy), axis=-1)
    plane = seen.copy()
    for _ in range(20):
        step = 1e-6
        residual = _bend(plane, shot) - seen
        if np.abs(residual).max() < 1e-12:
            break
        columns = [(_bend(plane + step * axis, shot) - residual - seen) / step for axis in np.eye(2)]
        plane -= np.linalg.solve(np.stack(columns, axis=-1), residual[..., None])[..., 0]
    rays = np.concatenate((plane, np.ones_like(plane[..., :1])), axis=-1)
    return wall_colour(shot.camera_to_world[:3, 3], rays @ shot.camera_to_world[:3, :3].T)


def _bend(plane: np.ndarray, shot: Shot) -> np.ndarray:
    """OpenCV's models, written out from its documentation."""
    x, y = plane[..., 0], plane[..., 1]
    k1, k2, k3, k4, k5, k6 = (shot.distortion.get(f"k{index}", 0.0) for index in range(1, 7))
    p1, p2 = (shot.distortion.get(key, 0.0) for key in ("p1", "p2"))
    r2 = x * x + y * y
    if shot.model == "OPENCV_FISHEYE":
        r = np.maximum(np.sqrt(r2), 1e-9)
        a = np.arctan(r)
        return plane * (a * (1 + k1 * a**2 + k2 * a**4 + k3 * a**6 + k4 * a**8) / r)[..., None]
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    radial = radial / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3) if shot.model == "FULL_OPENCV" else radial + k4 * r2**4
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack((bent_x, bent_y), axis=-1)


def write_photographs(folder: Path, taken: list[Shot]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for shot in taken:
        Image.fromarray((take(shot) * 255).round().astype(np.uint8)).save(folder / shot.name)


def transforms(taken: list[Shot], **top_level) -> dict:
    """What transforms.json holds: camera-to-world in OpenGL axes, everything in the frames."""
    frames = []
    for shot in taken:
        matrix = (shot.camera_to_world * [1, -1, -1, 1]).tolist()
        lens = {"fl_x": shot.fx, "fl_y": shot.fy, "cx": shot.cx, "cy": shot.cy, "w": shot.width, "h": shot.height}
        frames.append(
            {"file_path": f"images/{shot.name}", "transform_matrix": matrix}
            | ({} if shot.model == "OPENCV" else {"camera_model": shot.model})
            | lens
            | shot.distortion,
        )
    return top_level | {"frames": frames}


def write_transforms(folder: Path, taken: list[Shot], **top_level) -> Path:
    write_photographs(folder / "images", taken)
    (folder / "transforms.json").write_text(json.dumps(transforms(taken, **top_level)))
    return folder


@contextmanager
def edited(folder: Path, name: str = "transforms.json") -> Iterator[Any]:
    """The contents of a JSON file, which is written again after the block."""
    contents = json.loads((folder / name).read_text())
    yield contents
    (folder / name).write_text(json.dumps(contents))


def write_realestate10k(folder: Path, taken: list[Shot]) -> Path:
    write_photographs(folder, taken)
    lines = ["https://video.example/watch"]
    for shot in taken:
        lens = (shot.fx / shot.width, shot.fy / shot.height, shot.cx / shot.width, shot.cy / shot.height, 0, 0)
        pose = np.linalg.inv(shot.camera_to_world)[:3].ravel()
        lines.append(" ".join([Path(shot.name).stem, *(repr(float(value)) for value in (*lens, *pose))]))
    (folder / "clip.txt").write_text("\n".join(lines) + "\n")
    return folder


def write_cameras_json(folder: Path, taken: list[Shot]) -> Path:
    """`cameras.json` of 3DGS beside `images`: names without suffix, no principal point."""
    write_photographs(folder / "images", taken)
    cameras = [
        {
            **{"id": index, "img_name": Path(shot.name).stem, "width": shot.width, "height": shot.height},
            **{"position": shot.camera_to_world[:3, 3].tolist(), "rotation": shot.camera_to_world[:3, :3].tolist()},
            **{"fx": shot.fx, "fy": shot.fy},
        }
        for index, shot in enumerate(taken)
    ]
    (folder / "cameras.json").write_text(json.dumps(cameras))
    return folder


def write_llff(folder: Path, taken: list[Shot], bounds: tuple[float, float] = (2.0, 8.0)) -> Path:
    """`poses_bounds.npy` of LLFF beside `images`: axes are down, right, backwards; one focal length."""
    write_photographs(folder / "images", taken)
    rows = []
    for shot in taken:
        right, down, forward, position = shot.camera_to_world[:3].T
        size = np.array([shot.height, shot.width, shot.fx])
        rows.append([*np.stack((down, right, -forward, position, size), axis=-1).ravel(), *bounds])
    np.save(folder / "poses_bounds.npy", np.array(rows))
    return folder


def colmap_parameters(shot: Shot, model: str) -> list[float]:
    has_one_focal = model.startswith(("SIMPLE", "RADIAL"))
    focal = [shot.fx] if has_one_focal else [shot.fx, shot.fy]
    return [*focal, shot.cx, shot.cy, *(shot.distortion.get(key, 0.0) for key in COLMAP_COEFFICIENTS.get(model, []))]


def _colmap_pose(shot: Shot) -> tuple[list[float], list[float]]:
    world_to_camera = np.linalg.inv(shot.camera_to_world)
    x, y, z, w = Rotation.from_matrix(world_to_camera[:3, :3]).as_quat().tolist()
    return [w, x, y, z], world_to_camera[:3, 3].tolist()


def wall_points(count: int = 200) -> np.ndarray:
    xy = np.random.default_rng(0).uniform(-1, 1, (count, 2))
    return np.column_stack((xy, -(xy @ WALL[:2] + WALL[3]) / WALL[2]))


def write_colmap_text(folder: Path, taken: list[Shot], model: str = "OPENCV", where: str = "sparse/0") -> Path:
    write_photographs(folder / "images", taken)
    tables = folder / where
    tables.mkdir(parents=True, exist_ok=True)
    points = wall_points()
    cameras, images = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"], ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"]
    for number, shot in reversed(list(enumerate(taken, start=1))):
        parameters = " ".join(map(repr, colmap_parameters(shot, model)))
        cameras.append(f"{number} {model} {shot.width} {shot.height} {parameters}")
        rotation, translation = _colmap_pose(shot)
        images.append(" ".join([str(number), *map(repr, rotation + translation), str(number), shot.name]))
        images.append(" ".join(f"1.0 2.0 {point_id}" for point_id in (*range(len(points)), -1)))
    lines = [f"{index} {x!r} {y!r} {z!r} 0 0 0 0.5 1 {index}" for index, (x, y, z) in enumerate(points.tolist())]
    (tables / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (tables / "images.txt").write_text("\n".join(images) + "\n")
    (tables / "points3D.txt").write_text("\n".join(lines) + "\n")
    return folder


def write_colmap_binary(folder: Path, taken: list[Shot], model: str = "OPENCV", where: str = "sparse/0") -> Path:
    write_photographs(folder / "images", taken)
    tables = folder / where
    tables.mkdir(parents=True, exist_ok=True)
    points = wall_points()
    cameras = images = struct.pack("<Q", len(taken))
    for number, shot in reversed(list(enumerate(taken, start=1))):
        parameters = colmap_parameters(shot, model)
        cameras += struct.pack("<iiQQ", number, COLMAP_IDS[model], shot.width, shot.height)
        cameras += struct.pack(f"<{len(parameters)}d", *parameters)
        rotation, translation = _colmap_pose(shot)
        images += struct.pack("<i7di", number, *rotation, *translation, number) + shot.name.encode() + b"\0"
        images += struct.pack("<Q", len(points))
        images += b"".join(struct.pack("<ddq", 1.0, 2.0, point_id) for point_id in range(len(points)))
    table = struct.pack("<Q", len(points))
    for index, position in enumerate(points.tolist()):
        table += struct.pack("<Q3d3BdQii", index, *position, 0, 0, 0, 0.5, 1, 1, index)
    (tables / "cameras.bin").write_bytes(cameras)
    (tables / "images.bin").write_bytes(images)
    (tables / "points3D.bin").write_bytes(table)
    return folder
