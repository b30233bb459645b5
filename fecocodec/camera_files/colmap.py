"""COLMAP sparse models: poses are world-to-camera in OpenCV axes, pixel centres lie at i + 0.5."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.colmap_tables import (
    ColmapCamera,
    ColmapImage,
    ColmapModel,
    count_images,
    is_colmap_model,
    read_model,
)
from fecocodec.camera_files.image_matching import match_images
from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, photographs_of, require_numbers
from fecocodec.errors import InputError
from fecocodec.photographs.lens import MAX_SIDE_PX, Lens, lens_of_model, require_known_model

# Where models lie, in the order in which they are looked for. Models in one line are parts of one reconstruction.
_MODEL_FOLDERS = (
    ("sparse/0", "sparse", "sparse/*"),
    ("colmap/sparse/0", "colmap/sparse", "colmap/sparse/*"),
    (".", "[0-9]", "[0-9][0-9]"),
    ("dense/0/sparse", "dense/sparse", "dense/*/sparse"),  # COLMAP's undistorted images lie beside these
    ("*/sparse", "*/sparse/*"),
    ("sparse/*/*",),  # of `colmap mapper --output_path sparse/0`
    ("colmap",),
)
_PARAMETERS = {  # in COLMAP's order
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
}


def find_colmap_model(path: Path) -> Path | None:
    """Return the folder of the largest COLMAP model of a scene folder, None if there is none."""
    return next(iter(_models(path)), None)


def read_colmap(scene_folder: Path) -> PosedPhotographs:
    """Read the largest model, with images ordered by name; they lie in `images` of the scene folder or in that folder.

    Raises InputError if there is no model or a table is invalid. An image whose pose or camera model cannot be used has
    a problem.
    """
    folder, *others = _models(scene_folder)
    model = read_model(folder)
    if not model.images:
        raise InputError(f"{folder}: the COLMAP model has no registered images; reconstruct the scene again.")
    images = sorted(model.images, key=lambda image: image.name)
    found = match_images(folder, [image.name for image in images], _image_folders(scene_folder, folder))
    cameras = [(f"{folder}, image {image.name}", partial(_photograph, model, image)) for image in images]
    remarks = (*_choice(scene_folder, folder, len(images), others), *found.remarks)
    return PosedPhotographs(folder, photographs_of(found, cameras), remarks=remarks)


def _models(path: Path) -> list[Path]:
    """Return the models of the first place that has some, the largest first."""
    for patterns in _MODEL_FOLDERS:
        candidates = dict.fromkeys(folder for pattern in patterns for folder in _matching(path, pattern))
        if found := [folder for folder in candidates if is_colmap_model(folder)]:
            return sorted(found, key=count_images, reverse=True) if len(found) > 1 else found
    return []


def _matching(path: Path, pattern: str) -> Iterator[Path]:
    return iter(sorted(path.glob(pattern))) if set(pattern) & set("*[") else iter([path / pattern])


def _choice(scene_folder: Path, used: Path, count: int, others: list[Path]) -> tuple[str, ...]:
    """Return a sentence on the choice among several models."""
    if not others:
        return ()
    sizes = ", ".join(f"{folder.relative_to(scene_folder)} has {count_images(folder)}" for folder in others)
    return (
        f"of {len(others) + 1} COLMAP models, {used.relative_to(scene_folder)} is used, which has most images "
        f"({count}; {sizes}); give the folder of another one to use it.",
    )


def _image_folders(scene_folder: Path, model_folder: Path) -> list[Path]:
    """Return the folders that hold the images of a model: of the given folder, and of that around `sparse`."""
    above = [model_folder, *model_folder.parents][:2]
    around = next((folder.parent for folder in above if folder.name == "sparse"), scene_folder)
    return [folder for root in dict.fromkeys((around, scene_folder)) for folder in (root / "images", root)]


def _photograph(model: ColmapModel, image: ColmapImage, path: Path, place: str) -> PosedPhotograph:
    if image.camera_id not in model.cameras:
        raise InputError(f"{place}: its camera {image.camera_id} is not in the model; export the model again.")
    world_to_camera = _world_to_camera(image, place)
    camera = model.cameras[image.camera_id]
    points = np.array([model.points[point] for point in image.point_ids.tolist() if point in model.points])
    depths = points.reshape(-1, 3) @ world_to_camera[2, :3] + world_to_camera[2, 3]
    return PosedPhotograph(
        path=path,
        place=place,
        camera_to_world=np.linalg.inv(world_to_camera),
        lens_for=partial(_lens(camera, place).scaled_to, place=place),
        sparse_depths=depths[depths > 0],
        declared_size=(camera.width, camera.height),
    )


def _world_to_camera(image: ColmapImage, place: str) -> Float[np.ndarray, "4 4"]:
    quaternion = require_numbers(image.rotation, (4,), place)
    norm = np.linalg.norm(quaternion)
    if not 1e-6 < norm < 1e6:
        raise InputError(
            f"{place}: the pose is singular (its quaternion has length {norm:.3g}); export the model again."
        )
    w, x, y, z = quaternion / norm
    from scipy.spatial.transform import Rotation  # it loads slowly, and other camera files do not need it

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat((x, y, z, w)).as_matrix()
    matrix[:3, 3] = require_numbers(image.translation, (3,), place)
    return matrix


def _lens(camera: ColmapCamera, place: str) -> Lens:
    require_known_model(camera.model, place)
    names = _PARAMETERS[camera.model].split()
    parameters = require_numbers(camera.parameters, (len(names),), f"{place}, camera parameters")
    values = dict(zip(names, parameters.tolist(), strict=True))
    values = {"fx": values["f"], "fy": values["f"]} | values if "f" in values else values
    size = camera.width, camera.height
    if min(values["fx"], values["fy"], *size) <= 0 or max(size) > MAX_SIDE_PX:
        raise InputError(f"{place}: its focal length or image size is out of range; export the model again.")
    return lens_of_model(camera.model, size, values)
