"""The first steps of structure from motion, by pycolmap: features, and verified matches of pairs of photographs.

pycolmap has no type stubs; `pycolmap` is the module.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from fecocodec.photographs.image_headers import read_image_size
from fecocodec.poses.estimated_cameras import ImageGroup
from fecocodec.poses.likely_pairs import Features, Pair
from fecocodec.poses.pycolmap_steps import RADIAL_FROM, SEED

_PEAK_THRESHOLD = 0.003  # of SIFT; a lower one than the default finds more features in small photographs
_MANY = 12  # photographs; from here on, each has fewer features: the time of matching grows with both
_MOST_FEATURES, _MOST_FEATURES_OF_MANY = 8192, 4096  # of a photograph, those of the largest scale
# Pixels of a photograph. Many large ones are not enlarged to twice their size where that gives only features of smaller
# scale than the kept ones; it takes three quarters of the time.
_LARGE = 1 << 20

MatchedFeatures = Int[np.ndarray, "_ 2"]
FeaturePoints = Float[np.ndarray, "_ 2"]


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
    options.sift.max_num_features = _MOST_FEATURES if count < _MANY else _MOST_FEATURES_OF_MANY
    for group in groups:
        height, width = read_image_size(folder / group.names[0])
        lens = [group.focal_px, width / 2, height / 2]
        reader = pycolmap.ImageReaderOptions()
        if masks is not None:
            reader.mask_path = masks
        reader.camera_model = "SIMPLE_RADIAL" if count >= RADIAL_FROM else "SIMPLE_PINHOLE"
        reader.camera_params = ",".join(map(repr, lens + [0.0] * (count >= RADIAL_FROM)))
        chosen = {"camera_mode": pycolmap.CameraMode.SINGLE, "image_names": list(group.names)}
        # Threads of the extraction would number the photographs in the order in which they finish.
        pycolmap.import_images(database, folder, **chosen, options=reader)
        chosen |= {"reader_options": reader, "extraction_options": options, "device": pycolmap.Device.cpu}
        if count >= _MANY and width * height >= _LARGE:
            options.sift.first_octave = 0
            pycolmap.extract_features(database, folder, **chosen)
            _forget_features(pycolmap, database, group.names, options.sift.max_num_features)
        options.sift.first_octave = -1
        pycolmap.extract_features(database, folder, **chosen)  # of photographs that have none yet


def _forget_features(pycolmap: Any, database: Path, names: tuple[str, ...], least: int) -> None:
    """Delete the features of those of these photographs that have fewer than `least`."""
    with pycolmap.Database.open(database) as opened:
        ids = {image.image_id: image.name for image in opened.read_all_images()}
        kept = {
            image_id: (opened.read_keypoints(image_id), opened.read_descriptors(image_id))
            for image_id, name in ids.items()
            if opened.exists_keypoints(image_id)
            and (name not in names or opened.num_keypoints_for_image(image_id) >= least)
        }
        opened.clear_keypoints()
        opened.clear_descriptors()
        for image_id, (keypoints, descriptors) in kept.items():
            opened.write_keypoints(image_id, keypoints)
            opened.write_descriptors(image_id, descriptors)


def read_features(pycolmap: Any, database: Path) -> dict[str, Features]:
    """Return the scales and descriptors of the features of each photograph."""
    features = {}
    with pycolmap.Database.open(database) as opened:
        for image in opened.read_all_images():
            shapes = np.asarray(opened.read_keypoints(image.image_id), np.float64)[:, 2:6].reshape(-1, 2, 2)
            descriptors = np.asarray(opened.read_descriptors(image.image_id).data)
            features[image.name] = np.sqrt(np.abs(np.linalg.det(shapes))), descriptors
    return features


def match_pairs(pycolmap: Any, database: Path, pairs: list[Pair], num_threads: int, *, is_guided: bool = False) -> None:
    """Match pairs of photographs that are not matched yet, and verify the matches by two-view geometry.

    The list of pairs is written beside the database. is_guided: search more matches that fit the geometry, which takes
    ten times as long.
    """
    pair_list = database.parent / "pairs.txt"
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = num_threads
    matching.use_gpu = False
    matching.guided_matching = is_guided
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(pair_list)
    with _names_without_spaces(pycolmap, database) as names:
        pair_list.write_text("".join(f"{names[first]} {names[second]}\n" for first, second in pairs), "utf-8")
        pycolmap.match_image_pairs(
            database,
            matching_options=matching,
            verification_options=verification,
            pairing_options=pairing,
            device=pycolmap.Device.cpu,
        )


def forget_matches(pycolmap: Any, database: Path, pairs: list[Pair]) -> None:
    """Delete the matches of pairs of photographs, so that they can be matched again."""
    with pycolmap.Database.open(database) as opened:
        ids = {image.name: image.image_id for image in opened.read_all_images()}
        for first, second in pairs:
            opened.delete_matches(ids[first], ids[second])
            opened.delete_two_view_geometry(ids[first], ids[second])


@contextmanager
def _names_without_spaces(pycolmap: Any, database: Path) -> Iterator[dict[str, str]]:
    """Name the photographs by their numbers until the block ends: a list of pairs of pycolmap has no quotes."""
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
    numbered = {image_id: f":{image_id}" for image_id in names}  # no name of a file on every system
    _rename(pycolmap, database, numbered)
    try:
        yield {name: numbered[image_id] for image_id, name in names.items()}
    finally:
        _rename(pycolmap, database, names)


def _rename(pycolmap: Any, database: Path, names: dict[int, str]) -> None:
    with pycolmap.Database.open(database) as opened:
        for image in opened.read_all_images():
            image.name = names[image.image_id]
            opened.update_image(image)


def verified_matches(pycolmap: Any, database: Path) -> dict[Pair, MatchedFeatures]:
    """Return the numbers of the matched features of every pair of photographs (names in order) that has any."""
    with pycolmap.Database.open(database) as opened:
        name_of = {image.image_id: image.name for image in opened.read_all_images()}
        pair_ids, geometries = opened.read_two_view_geometries()
    matches = {}
    for pair_id, geometry in zip(pair_ids, geometries, strict=True):
        first, second = (name_of[image_id] for image_id in pycolmap.pair_id_to_image_pair(pair_id))
        numbers = np.asarray(geometry.inlier_matches, np.int64).reshape(-1, 2)
        if len(numbers):
            matches[min(first, second), max(first, second)] = numbers if first < second else numbers[:, ::-1]
    return matches


def read_points(pycolmap: Any, database: Path) -> dict[str, FeaturePoints]:
    """Return the positions of the features of each photograph in pixels."""
    with pycolmap.Database.open(database) as opened:
        return {
            image.name: np.asarray(opened.read_keypoints(image.image_id), np.float64)[:, :2]
            for image in opened.read_all_images()
        }


def reached_points(model: Any, matches: dict[Pair, MatchedFeatures]) -> dict[str, int]:
    """Return how many features of each photograph without a camera match a reconstructed point.

    matches: numbers of the matched features of pairs of photographs.
    """
    images = [model.image(image_id) for image_id in model.reg_image_ids()]
    has_point = {image.name: np.array([point.has_point3D() for point in image.points2D]) for image in images}
    reached: dict[str, set[int]] = {}
    for (first, second), numbers in matches.items():
        for name, other, own, others in ((first, second, *numbers.T), (second, first, *numbers.T[::-1])):
            if name not in has_point and other in has_point:
                reached.setdefault(name, set()).update(own[has_point[other][others]].tolist())
    return {name: len(features) for name, features in reached.items()}
