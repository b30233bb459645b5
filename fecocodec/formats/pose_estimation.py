"""Estimate the cameras of 2 to 60 photographs of a static scene with pycolmap (optional extra `poses`).

SIFT features, exhaustive matching, incremental reconstruction, and a last bundle adjustment with a robust loss. The
initialisation is loosened step by step, because few views give few points and small angles. Method: Schönberger and
Frahm, "Structure-from-Motion Revisited", 2016.
"""

import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError
from fecocodec.formats.lens import Lens

LEAST_ANGLE = 1.0  # degrees, median angle between the rays of a point; with less, depth is not determined
_SEED = 0
_RADIAL_FROM = 6  # photographs; fewer do not determine the lens distortion
_FOCAL_RANGE = (0.3, 3.0)  # longer image sides; a lens of 11 to 108 mm on 35 mm film
_PEAK_THRESHOLD = 0.003  # of SIFT; a lower one than the default finds more features in small photographs
# Smallest angle (degrees) and number of inliers of the first pair, and number of inliers of a further photograph.
_ATTEMPTS = ((8.0, 60, 24), (4.0, 40, 18), (2.0, 25, 14), (1.0, 20, 12))
# Share of the verified matches that a reconstruction has to explain, else looser attempts follow.
_ENOUGH_EXPLAINED = 0.5
_OTHER_FOCAL = 4 / 3  # initial focal length of the second estimate, relative to the first
_LEAST_BASELINE = 0.3  # of the longest one; directions of shorter ones are not compared
# Pixels; scale of the Cauchy loss of the last bundle adjustment. With squared errors, the outliers of up to 4 pixels
# that the reconstruction keeps move the focal length by some percent.
_LOSS_SCALE_PX = 0.5
_MAX_REFINEMENT_STEPS = 100


@dataclass(frozen=True)
class ImageGroup:
    """Photographs of one size, taken to share their lens. focal_px: initial focal length in pixels.

    is_known: whether the focal length comes from EXIF data. It is refined in both cases.
    """

    names: tuple[str, ...]
    focal_px: float
    is_known: bool


@dataclass(frozen=True)
class EstimatedCamera:
    """The camera of one registered photograph. camera_to_world: OpenCV axes, in the frame of the first camera.

    depths: of the reconstructed points that it observes, in the unit of the reconstruction.
    """

    name: str
    lens: Lens
    camera_to_world: Float[np.ndarray, "4 4"]
    depths: Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Reconstruction:
    """Registered cameras in the order of their names, and the quality of the reconstruction.

    reprojection_error_px: mean over observations. angle: median angle in degrees between the rays of a point.
    matches: number of verified matches of each pair of photographs (names in order). difference: of the rotations and
    directions between cameras, in degrees, from a second estimate that starts from another focal length; see
    `pose_difference`. It is None if the second estimate lacks a camera.
    """

    cameras: tuple[EstimatedCamera, ...]
    reprojection_error_px: float
    angle: float
    matches: dict[tuple[str, str], int]
    difference: tuple[float, float] | None


def reconstruct(folder: Path, groups: list[ImageGroup], workspace: Path, num_threads: int = -1) -> Reconstruction:
    """Reconstruct the photographs in `folder`. workspace: an empty folder for the database.

    num_threads: of features and matching, -1 for all cores; the cameras do not depend on it. Raises InputError if
    pycolmap is missing; the result has no cameras if no pair of photographs can be reconstructed.
    """
    pycolmap = _pycolmap()
    database = workspace / "database.db"
    pycolmap.Database.open(database).close()  # creates it
    _extract(pycolmap, database, folder, groups, num_threads)
    _match(pycolmap, database, num_threads)
    matches = _verified_matches(pycolmap, database)
    count = sum(len(group.names) for group in groups)
    best = map_photographs(pycolmap, database, folder, workspace / "first", _ATTEMPTS, matches, count)
    if best is None:
        return Reconstruction((), 0.0, 0.0, matches, None)
    refined = refine(pycolmap, best, count)
    cameras = _cameras(refined)
    _change_focal_lengths(pycolmap, database)
    second = map_photographs(pycolmap, database, folder, workspace / "second", _ATTEMPTS[-1:], matches, count)
    difference = None if second is None else pose_difference(cameras, _cameras(refine(pycolmap, second, count)))
    error, angle = refined.compute_mean_reprojection_error(), _median_angle(refined)
    return Reconstruction(cameras, error, angle, matches, difference)


def pose_difference(
    first: tuple[EstimatedCamera, ...], second: tuple[EstimatedCamera, ...]
) -> tuple[float, float] | None:
    """Return the largest differences of the rotation and direction between two cameras, over all pairs, in degrees.

    Directions between cameras that are close to each other are ignored, as they are uncertain. None if a camera of
    the first estimate is missing in the second.
    """
    poses = {camera.name: camera.camera_to_world for camera in second}
    if any(camera.name not in poses for camera in first):
        return None
    pairs = [(one, other) for index, one in enumerate(first) for other in first[:index]]
    known = [np.linalg.inv(one.camera_to_world) @ other.camera_to_world for one, other in pairs]
    found = [np.linalg.inv(poses[one.name]) @ poses[other.name] for one, other in pairs]
    rotation = max(_angle_of(a[:3, :3].T @ b[:3, :3]) for a, b in zip(known, found, strict=True))
    longest = max(np.linalg.norm(pose[:3, 3]) for pose in known)
    direction = max(
        _angle_between(a[:3, 3], b[:3, 3])
        for a, b in zip(known, found, strict=True)
        if np.linalg.norm(a[:3, 3]) > _LEAST_BASELINE * longest
    )
    return rotation, direction


def _angle_of(rotation: Float[np.ndarray, "3 3"]) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def _angle_between(first: Float[np.ndarray, " 3"], second: Float[np.ndarray, " 3"]) -> float:
    cosine = first @ second / max(1e-12, float(np.linalg.norm(first) * np.linalg.norm(second)))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def map_photographs(
    pycolmap: Any,
    database: Path,
    folder: Path,
    workspace: Path,
    attempts: tuple[tuple[float, int, int], ...],
    matches: dict[tuple[str, str], int],
    count: int,
) -> Any:
    """Return the reconstruction with the most photographs, then with the most explained matches; None without one."""
    best, most = None, (0, 0.0)
    for number, attempt in enumerate(attempts):
        output = workspace / str(number)
        output.mkdir(parents=True)
        options = _mapping_options(pycolmap, attempt, count)
        for model in pycolmap.incremental_mapping(database, folder, output, options).values():
            extent = model.num_reg_images(), _explained_share(model, matches)
            if _is_plausible(model) and extent > most:
                best, most = model, extent
        if most[0] == count and most[1] >= _ENOUGH_EXPLAINED:
            break
    return best


def _change_focal_lengths(pycolmap: Any, database: Path) -> None:
    """Multiply the initial focal lengths by _OTHER_FOCAL."""
    with pycolmap.Database.open(database) as opened:
        for camera in opened.read_all_cameras():
            camera.params = np.array([_OTHER_FOCAL * camera.params[0], *camera.params[1:]])
            opened.update_camera(camera)


def _pycolmap() -> Any:
    try:
        import pycolmap
    except ImportError as error:
        raise InputError(
            "cameras of photographs without poses are estimated with pycolmap, which is not installed; run "
            "`pip install 'fecosplat[poses]'`."
        ) from error
    pycolmap.logging.minloglevel = 3  # fatal errors only; its messages go to stderr otherwise
    pycolmap.set_random_seed(_SEED)
    _restore_sigterm()
    return pycolmap


def _restore_sigterm() -> None:
    """Install Python's handler of SIGTERM again: pycolmap replaces it by one that prints a stack and ends the process.

    Only the main thread of Python can install handlers; in any other, pycolmap's remains.
    """
    handler = signal.getsignal(signal.SIGTERM)  # as Python knows it
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)


def _extract(pycolmap: Any, database: Path, folder: Path, groups: list[ImageGroup], num_threads: int) -> None:
    """Extract features; every group of photographs gets one camera."""
    count = sum(len(group.names) for group in groups)
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = num_threads
    options.use_gpu = False
    options.sift.peak_threshold = _PEAK_THRESHOLD
    for group in groups:
        height, width = _size(pycolmap, folder / group.names[0])
        lens = [group.focal_px, width / 2, height / 2]
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = "SIMPLE_RADIAL" if count >= _RADIAL_FROM else "SIMPLE_PINHOLE"
        reader.camera_params = ",".join(map(repr, lens + [0.0] * (count >= _RADIAL_FROM)))
        # Threads of the extraction would number the photographs in the order in which they finish.
        pycolmap.import_images(
            database, folder, camera_mode=pycolmap.CameraMode.SINGLE, image_names=list(group.names), options=reader
        )
        pycolmap.extract_features(
            database,
            folder,
            image_names=list(group.names),
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=options,
            device=pycolmap.Device.cpu,
        )


def _size(pycolmap: Any, path: Path) -> tuple[int, int]:
    bitmap = pycolmap.Bitmap.read(path, as_rgb=False)
    return bitmap.height, bitmap.width


def _match(pycolmap: Any, database: Path, num_threads: int) -> None:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = num_threads
    options.use_gpu = False
    options.guided_matching = True
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = _SEED
    pycolmap.match_exhaustive(
        database, matching_options=options, verification_options=verification, device=pycolmap.Device.cpu
    )


def _mapping_options(pycolmap: Any, attempt: tuple[float, int, int], count: int) -> Any:
    angle, num_init_inliers, num_inliers = attempt
    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = 2
    options.num_threads = 1  # several threads give other cameras at each run
    options.random_seed = _SEED
    options.extract_colors = False
    options.ba_refine_extra_params = count >= _RADIAL_FROM
    for limited in (options, options.mapper, options.triangulation):
        limited.min_focal_length_ratio, limited.max_focal_length_ratio = _FOCAL_RANGE
    options.mapper.init_min_tri_angle = angle
    options.mapper.init_min_num_inliers = num_init_inliers
    options.mapper.abs_pose_min_num_inliers = num_inliers
    options.mapper.abs_pose_min_inlier_ratio = 0.15
    options.mapper.filter_min_tri_angle = min(1.5, angle / 2)
    options.triangulation.min_angle = min(1.5, angle / 2)
    options.triangulation.ignore_two_view_tracks = False  # few views: most points are seen by two
    return options


def refine(pycolmap: Any, model: Any, count: int) -> Any:
    """Return the model after bundle adjustment with a robust loss; the model itself if that is not plausible."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_extra_params = count >= _RADIAL_FROM
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = _LOSS_SCALE_PX
    options.ceres.solver_options.max_num_iterations = _MAX_REFINEMENT_STEPS
    options.ceres.solver_options.num_threads = 1
    refined = pycolmap.Reconstruction(model)
    images = pycolmap.BundleAdjustmentConfig()
    for image_id in refined.reg_image_ids():
        images.add_image(image_id)
    images.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # `pycolmap.bundle_adjustment` does the same and writes to stderr at every log level.
    pycolmap.create_default_bundle_adjuster(options, images, refined).solve()
    return refined if _is_plausible(refined) else model


def _is_plausible(model: Any) -> bool:
    """Return whether all focal lengths are within _FOCAL_RANGE; bundle adjustment can leave it."""
    ratios = [camera.params[0] / max(camera.width, camera.height) for camera in model.cameras.values()]
    return all(_FOCAL_RANGE[0] <= ratio <= _FOCAL_RANGE[1] for ratio in ratios)


def _explained_share(model: Any, matches: dict[tuple[str, str], int]) -> float:
    """Return the number of pairs of observations of one point, per verified match. Guided matches can exceed 1."""
    lengths = [point.track.length() for point in model.points3D.values()]
    return sum(length * (length - 1) / 2 for length in lengths) / max(1, sum(matches.values()))


def _verified_matches(pycolmap: Any, database: Path) -> dict[tuple[str, str], int]:
    """Return the number of verified matches of every pair of photographs that has any."""
    with pycolmap.Database.open(database) as opened:
        name_of = {image.image_id: image.name for image in opened.read_all_images()}
        pair_ids, counts = opened.read_two_view_geometry_num_inliers()
        pairs = [pycolmap.pair_id_to_image_pair(pair_id) for pair_id in pair_ids]
        named = [sorted((name_of[first], name_of[second])) for first, second in pairs]
    return {(first, second): int(count) for (first, second), count in zip(named, counts, strict=True)}


def _cameras(model: Any) -> tuple[EstimatedCamera, ...]:
    """Return the registered cameras, in the frame of the first one."""
    images = sorted((model.image(image_id) for image_id in model.reg_image_ids()), key=lambda image: image.name)
    points = {point_id: point.xyz for point_id, point in model.points3D.items()}
    world_to_first = _matrix(images[0])
    cameras = []
    for image in images:
        world_to_camera = _matrix(image)
        seen = [points[point.point3D_id] for point in image.points2D if point.has_point3D()]
        depths = np.array(seen).reshape(-1, 3) @ world_to_camera[2, :3] + world_to_camera[2, 3]
        pose = world_to_first @ np.linalg.inv(world_to_camera)
        cameras.append(EstimatedCamera(image.name, _lens(model.camera(image.camera_id)), pose, depths[depths > 0]))
    return tuple(cameras)


def _matrix(image: Any) -> Float[np.ndarray, "4 4"]:
    """Return the world-to-camera matrix."""
    pose = np.eye(4)
    pose[:3] = image.cam_from_world().matrix()
    return pose


def _lens(camera: Any) -> Lens:
    """Convert SIMPLE_PINHOLE (f, cx, cy) or SIMPLE_RADIAL (f, cx, cy, k)."""
    focal, cx, cy, *radial = map(float, camera.params)
    return Lens(camera.width, camera.height, focal, focal, cx, cy, tuple(radial))


def _median_angle(model: Any) -> float:
    """Return the median over points of the largest angle, in degrees, between the rays to cameras that observe it."""
    centres = {image_id: model.image(image_id).projection_center() for image_id in model.reg_image_ids()}
    angles = []
    for point in model.points3D.values():
        observers = {element.image_id for element in point.track.elements}
        rays = np.array([centres[image_id] - point.xyz for image_id in observers])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        angles.append(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1, 1))))
    return float(np.median(angles)) if angles else 0.0
