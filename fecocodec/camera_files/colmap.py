"""COLMAP sparse models: poses are world-to-camera in OpenCV axes, pixel centres lie at i + 0.5."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fecocodec.camera_files.colmap_binary import read_binary_model
from fecocodec.camera_files.colmap_model import ColmapCamera, ColmapImage, ColmapModel
from fecocodec.camera_files.colmap_text import read_text_model
from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs, find_image, require_numbers
from fecocodec.errors import InputError
from fecocodec.photographs.lens import MAX_SIDE_PX, Lens

_MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
_NUM_PARAMETERS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8}


def find_colmap_model(path: Path) -> Path | None:
    """Return the folder with the tables of the COLMAP model of a scene folder, None if there is none."""
    folders = (path / folder for folder in _MODEL_FOLDERS)
    return next((folder for folder in folders if _is_binary(folder) or (folder / "images.txt").is_file()), None)


def read_colmap(scene_folder: Path, model_folder: Path) -> PosedPhotographs:
    """Read a model, with images ordered by name. Image files are in `images/` of the scene folder or in that folder.

    Raises InputError if a table is invalid, a camera model is not supported, or a pose is not valid.
    """
    model = read_binary_model(model_folder) if _is_binary(model_folder) else read_text_model(model_folder)
    if not model.images:
        raise InputError(f"{model_folder}: the COLMAP model has no registered images; reconstruct the scene again.")
    images = sorted(model.images, key=lambda image: image.name)
    image_folder = _image_folder(scene_folder, images[0].name)
    return PosedPhotographs(model_folder, [_photograph(model_folder, image_folder, model, image) for image in images])


def _photograph(model_folder: Path, image_folder: Path, model: ColmapModel, image: ColmapImage) -> PosedPhotograph:
    place = f"{model_folder}, image {image.name}"
    if image.camera_id not in model.cameras:
        raise InputError(f"{place}: its camera {image.camera_id} is not in the model; export the model again.")
    world_to_camera = _world_to_camera(image, place)
    camera = model.cameras[image.camera_id]
    points = np.array([model.points[point] for point in image.point_ids.tolist() if point in model.points])
    depths = points.reshape(-1, 3) @ world_to_camera[2, :3] + world_to_camera[2, 3]
    return PosedPhotograph(
        path=find_image(image_folder, image.name),
        place=place,
        camera_to_world=np.linalg.inv(world_to_camera),
        lens_for=partial(_lens, camera, place),
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


def _lens(camera: ColmapCamera, place: str, width: int, height: int) -> Lens:
    if camera.model not in _NUM_PARAMETERS:
        raise InputError(
            f"{place}: camera model {camera.model} is not supported; undistort with `colmap image_undistorter` first."
        )
    parameters = require_numbers(camera.parameters, (_NUM_PARAMETERS[camera.model],), f"{place}, camera parameters")
    values = [float(value) for value in parameters]
    if camera.model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"):  # one focal length
        values.insert(0, values[0])
    fx, fy, cx, cy, *distortion = values
    if min(fx, fy, camera.width, camera.height) <= 0 or max(camera.width, camera.height) > MAX_SIDE_PX:
        raise InputError(f"{place}: its focal length or image size is out of range; export the model again.")
    tangential = (distortion[2], distortion[3]) if camera.model == "OPENCV" else (0.0, 0.0)
    lens = Lens(camera.width, camera.height, fx, fy, cx, cy, tuple(distortion[:2]), tangential)
    return lens.scaled_to(width, height, place)


def _image_folder(scene_folder: Path, first_name: str) -> Path:
    """Return the folder of the image files. `scene_folder` may also be the model folder inside a scene folder."""
    above = [parent / "images" for parent in scene_folder.resolve().parents[:2]]
    folders = [scene_folder / "images", scene_folder, *above]
    return next((folder for folder in folders if (folder / first_name).is_file()), folders[0])


def _is_binary(folder: Path) -> bool:
    return (folder / "images.bin").is_file()
