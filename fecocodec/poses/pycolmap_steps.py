"""The last steps of structure from motion, by pycolmap: mapping of matched photographs, and bundle adjustment.

pycolmap has no type stubs; `pycolmap` is the module, and models are its `Reconstruction`s.
"""

import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np

from fecocodec.errors import InputError, installation

SEED = 0
RADIAL_FROM = 6  # photographs; fewer do not determine the lens distortion
_MANY = 12  # photographs; with more, all cameras are adjusted less often before the last bundle adjustment
_GROWTH, _MOST_REFINEMENTS = 1.3, 2  # of cameras or points until the next adjustment of all, and steps of one
# The last adjustment of many photographs ends when a step lowers the cost by a smaller share than this. With few
# photographs, such steps still move the cameras.
_LEAST_GAIN = 1e-5
_FOCAL_RANGE = (0.3, 3.0)  # longer image sides; a lens of 11 to 108 mm on 35 mm film
_ANY_FOCAL = (0.01, 100.0)  # a given one was checked
# Share of the verified matches that a reconstruction has to explain, else looser attempts follow.
_ENOUGH_EXPLAINED = 0.5
# Pixels; scale of the Cauchy loss of the last bundle adjustment. With squared errors, the outliers of up to 4 pixels
# that the reconstruction keeps move the focal length by some percent.
_LOSS_SCALE_PX = 0.5
_MAX_REFINEMENT_STEPS = 100


def map_photographs(
    pycolmap: Any,
    database: Path,
    folder: Path,
    workspace: Path,
    attempts: tuple[tuple[float, int, int], ...],
    num_matches: int,
    count: int,
    *,
    is_focal_fixed: bool = False,
) -> Any:
    """Return the reconstruction with the most photographs, then with the most explained matches; None without one.

    num_matches: verified ones of all pairs. count: of photographs. is_focal_fixed: whether the initial focal lengths
    are kept.
    """
    pycolmap.set_random_seed(SEED)  # of this thread
    best, most = None, (0, 0.0)
    for number, attempt in enumerate(attempts):
        output = workspace / str(number)
        output.mkdir(parents=True)
        options = _mapping_options(pycolmap, attempt, count, is_focal_fixed)
        for model in pycolmap.incremental_mapping(database, folder, output, options).values():
            extent = model.num_reg_images(), _explained_share(model, num_matches)
            if (is_focal_fixed or _is_plausible(model)) and extent > most:
                best, most = model, extent
        if most[0] == count and most[1] >= _ENOUGH_EXPLAINED:
            break
    return best


def set_focal_lengths(pycolmap: Any, database: Path, focals_px: list[float]) -> None:
    """Change the initial focal lengths of the cameras, in the order in which they were made."""
    with pycolmap.Database.open(database) as opened:
        for camera, focal_px in zip(opened.read_all_cameras(), focals_px, strict=True):
            camera.params = np.array([focal_px, *camera.params[1:]])
            opened.update_camera(camera)


def load_pycolmap() -> Any:
    """Return the module, silent and with a fixed seed. Raises InputError if it is not installed."""
    try:
        import pycolmap
    except ImportError as error:
        raise InputError(
            "cameras of photographs without poses are estimated with pycolmap, which is not installed; run "
            f"{installation('poses')}."
        ) from error
    pycolmap.logging.minloglevel = 3  # fatal errors only; its messages go to stderr otherwise
    pycolmap.set_random_seed(SEED)
    _restore_sigterm()
    return pycolmap


def _restore_sigterm() -> None:
    """Install Python's handler of SIGTERM again: pycolmap replaces it by one that prints a stack and ends the process.

    Only the main thread of Python can install handlers; in any other, pycolmap's remains.
    """
    handler = signal.getsignal(signal.SIGTERM)  # as Python knows it
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)


def _mapping_options(pycolmap: Any, attempt: tuple[float, int, int], count: int, is_focal_fixed: bool) -> Any:
    angle, num_init_inliers, num_inliers = attempt
    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = 2
    options.num_threads = 1  # several threads give other cameras at each run
    options.random_seed = SEED
    options.extract_colors = False
    if count > _MANY:
        options.ba_global_frames_ratio = options.ba_global_points_ratio = _GROWTH
        options.ba_global_max_refinements = _MOST_REFINEMENTS
    options.ba_refine_extra_params = count >= RADIAL_FROM
    options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = not is_focal_fixed
    for limited in (options, options.mapper, options.triangulation):
        limited.min_focal_length_ratio, limited.max_focal_length_ratio = _ANY_FOCAL if is_focal_fixed else _FOCAL_RANGE
    options.mapper.init_min_tri_angle = angle
    options.mapper.init_min_num_inliers = num_init_inliers
    options.mapper.abs_pose_min_num_inliers = num_inliers
    options.mapper.abs_pose_min_inlier_ratio = 0.15
    options.mapper.filter_min_tri_angle = min(1.5, angle / 2)
    options.triangulation.min_angle = min(1.5, angle / 2)
    options.triangulation.ignore_two_view_tracks = False  # few views: most points are seen by two
    return options


def refine(pycolmap: Any, model: Any, count: int, *, is_focal_fixed: bool = False) -> Any:
    """Return the model after bundle adjustment with a robust loss; the model itself if that is not plausible."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = not is_focal_fixed
    options.refine_extra_params = count >= RADIAL_FROM
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = _LOSS_SCALE_PX
    options.ceres.solver_options.max_num_iterations = _MAX_REFINEMENT_STEPS
    if count > _MANY:
        options.ceres.solver_options.function_tolerance = _LEAST_GAIN
    options.ceres.solver_options.num_threads = 1
    refined = pycolmap.Reconstruction(model)
    images = pycolmap.BundleAdjustmentConfig()
    for image_id in refined.reg_image_ids():
        images.add_image(image_id)
    images.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # `pycolmap.bundle_adjustment` does the same and writes to stderr at every log level.
    pycolmap.create_default_bundle_adjuster(options, images, refined).solve()
    return refined if is_focal_fixed or _is_plausible(refined) else model


def _is_plausible(model: Any) -> bool:
    """Return whether all focal lengths are within _FOCAL_RANGE; bundle adjustment can leave it."""
    ratios = [camera.params[0] / max(camera.width, camera.height) for camera in model.cameras.values()]
    return all(_FOCAL_RANGE[0] <= ratio <= _FOCAL_RANGE[1] for ratio in ratios)


def _explained_share(model: Any, num_matches: int) -> float:
    """Return the number of pairs of observations of one point, per verified match. It can exceed 1."""
    lengths = [point.track.length() for point in model.points3D.values()]
    return sum(length * (length - 1) / 2 for length in lengths) / max(1, num_matches)
