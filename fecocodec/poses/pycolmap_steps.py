"""The steps of structure from motion, by pycolmap: features, matches, mapping, and bundle adjustment.

pycolmap has no type stubs; `pycolmap` is the module, and models are its `Reconstruction`s.
"""

import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError, installation
from fecocodec.poses.estimated_cameras import ImageGroup

_SEED = 0
_RADIAL_FROM = 6  # photographs; fewer do not determine the lens distortion
_FOCAL_RANGE = (0.3, 3.0)  # longer image sides; a lens of 11 to 108 mm on 35 mm film
_ANY_FOCAL = (0.01, 100.0)  # a given one was checked
_PEAK_THRESHOLD = 0.003  # of SIFT; a lower one than the default finds more features in small photographs
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
    matches: dict[tuple[str, str], int],
    count: int,
    *,
    is_focal_fixed: bool = False,
) -> Any:
    """Return the reconstruction with the most photographs, then with the most explained matches; None without one.

    is_focal_fixed: whether the initial focal lengths are kept.
    """
    best, most = None, (0, 0.0)
    for number, attempt in enumerate(attempts):
        output = workspace / str(number)
        output.mkdir(parents=True)
        options = _mapping_options(pycolmap, attempt, count, is_focal_fixed)
        for model in pycolmap.incremental_mapping(database, folder, output, options).values():
            extent = model.num_reg_images(), _explained_share(model, matches)
            if (is_focal_fixed or _is_plausible(model)) and extent > most:
                best, most = model, extent
        if most[0] == count and most[1] >= _ENOUGH_EXPLAINED:
            break
    return best


def change_focal_lengths(pycolmap: Any, database: Path, factor: float) -> None:
    """Multiply the initial focal lengths."""
    with pycolmap.Database.open(database) as opened:
        for camera in opened.read_all_cameras():
            camera.params = np.array([factor * camera.params[0], *camera.params[1:]])
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


def extract_features(
    pycolmap: Any, database: Path, folder: Path, groups: list[ImageGroup], num_threads: int, masks: Path | None = None
) -> None:
    """Extract features; every group of photographs gets one camera.

    masks: folder of `NAME.png`, where features of black pixels are left out; None without masks.
    """
    count = sum(len(group.names) for group in groups)
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = num_threads
    options.use_gpu = False
    options.sift.peak_threshold = _PEAK_THRESHOLD
    for group in groups:
        height, width = _size(pycolmap, folder / group.names[0])
        lens = [group.focal_px, width / 2, height / 2]
        reader = pycolmap.ImageReaderOptions()
        if masks is not None:
            reader.mask_path = masks
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


def match_features(pycolmap: Any, database: Path, num_threads: int) -> None:
    """Match all pairs of photographs that are not matched yet, and verify the matches by two-view geometry."""
    pycolmap.match_exhaustive(database, **_matching_options(pycolmap, num_threads), device=pycolmap.Device.cpu)


def match_pair(pycolmap: Any, database: Path, first: str, second: str, pair_list: Path, num_threads: int) -> None:
    """Match one pair as `match_features` does. pair_list: a file to write."""
    pair_list.write_text(f"{first} {second}\n", "utf-8")
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(pair_list)
    options = _matching_options(pycolmap, num_threads)
    pycolmap.match_image_pairs(database, **options, pairing_options=pairing, device=pycolmap.Device.cpu)


def _matching_options(pycolmap: Any, num_threads: int) -> dict[str, Any]:
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = num_threads
    options.use_gpu = False
    options.guided_matching = True
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = _SEED
    return {"matching_options": options, "verification_options": verification}


def _mapping_options(pycolmap: Any, attempt: tuple[float, int, int], count: int, is_focal_fixed: bool) -> Any:
    angle, num_init_inliers, num_inliers = attempt
    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = 2
    options.num_threads = 1  # several threads give other cameras at each run
    options.random_seed = _SEED
    options.extract_colors = False
    options.ba_refine_extra_params = count >= _RADIAL_FROM
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
    return refined if is_focal_fixed or _is_plausible(refined) else model


def _is_plausible(model: Any) -> bool:
    """Return whether all focal lengths are within _FOCAL_RANGE; bundle adjustment can leave it."""
    ratios = [camera.params[0] / max(camera.width, camera.height) for camera in model.cameras.values()]
    return all(_FOCAL_RANGE[0] <= ratio <= _FOCAL_RANGE[1] for ratio in ratios)


def _explained_share(model: Any, matches: dict[tuple[str, str], int]) -> float:
    """Return the number of pairs of observations of one point, per verified match. Guided matches can exceed 1."""
    lengths = [point.track.length() for point in model.points3D.values()]
    return sum(length * (length - 1) / 2 for length in lengths) / max(1, sum(matches.values()))


def verified_matches(pycolmap: Any, database: Path) -> dict[tuple[str, str], int]:
    """Return the number of verified matches of every pair of photographs that has any."""
    with pycolmap.Database.open(database) as opened:
        name_of = {image.image_id: image.name for image in opened.read_all_images()}
        pair_ids, counts = opened.read_two_view_geometry_num_inliers()
        pairs = [pycolmap.pair_id_to_image_pair(pair_id) for pair_id in pair_ids]
        named = [sorted((name_of[first], name_of[second])) for first, second in pairs]
    return {(first, second): int(count) for (first, second), count in zip(named, counts, strict=True)}


def matched_points(
    pycolmap: Any, database: Path, first: str, second: str
) -> tuple[Float[np.ndarray, "match 2"], Float[np.ndarray, "match 2"]]:
    """Return the points of the verified matches of two photographs in pixels."""
    with pycolmap.Database.open(database) as opened:
        ids = {image.name: image.image_id for image in opened.read_all_images()}
        pairs = np.asarray(opened.read_two_view_geometry(ids[first], ids[second]).inlier_matches).reshape(-1, 2)
        points = [np.asarray(opened.read_keypoints(ids[name]), np.float64)[:, :2] for name in (first, second)]
    return points[0][pairs[:, 0]], points[1][pairs[:, 1]]
