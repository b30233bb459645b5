"""Cameras of photographs without poses: the example scene with its known cameras, and inputs without a solution."""

import errno
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageFilter
from scipy.ndimage import map_coordinates

from fecocodec.camera_files.find import has_cameras, read_cameras
from fecocodec.camera_files.transforms_json import read_transforms_json
from fecocodec.camera_files.unused_cameras import earlier_estimate_notes, unread_cameras_notes
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError, OutputError
from fecocodec.photographs.lens import Lens
from fecocodec.poses import pycolmap_matching, pycolmap_steps
from fecocodec.poses.estimated_cameras import (
    Ambiguity,
    EstimatedCamera,
    ImageGroup,
    Reconstruction,
    angle_between,
    pose_difference,
    rotation_angle,
)
from fecocodec.poses.pose_warnings import reliability_warnings
from fecocodec.poses.posed_folder import _left_out, _of_photograph, posed_folder
from fecocodec.poses.pycolmap_matching import read_points
from fecocodec.poses.pycolmap_steps import refine
from fecocodec.poses.unposed_photographs import upright_copies, upright_masks
from fecocodec.poses.usable_estimate import obstacle, require_usable
from tests.poses.made_up_cameras import camera

pycolmap = pytest.importorskip("pycolmap")
EXAMPLE = Path(__file__).parents[2] / "examples" / "motorcycle"
PHOTOGRAPHS = [photograph.path for photograph in read_transforms_json(EXAMPLE / "transforms.json").photographs]


def copies(folder: Path, reduction: int = 1) -> list[Path]:
    """Write the photographs to a folder. At half their size, estimation takes a third of the time."""
    folder.mkdir(exist_ok=True)
    for path in PHOTOGRAPHS:
        Image.open(path).reduce(reduction).save(folder / path.name)
    return [folder / path.name for path in PHOTOGRAPHS]


def turned(image: np.ndarray, degrees: float, focal_px: float) -> np.ndarray:
    """Return the image of the same camera after a rotation about the vertical axis."""
    height, width = image.shape[:2]
    angle = np.radians(degrees)
    rows, columns = np.meshgrid(np.arange(height) - height / 2, np.arange(width) - width / 2, indexing="ij")
    rays = np.stack((columns / focal_px, rows / focal_px, np.ones_like(rows)))
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    x, y, z = np.einsum("ij,jhw->ihw", rotation, rays)
    position = np.stack((y / z * focal_px + height / 2, x / z * focal_px + width / 2))
    channels = [map_coordinates(channel.astype(float), position, order=1) for channel in np.moveaxis(image, 2, 0)]
    return np.stack(channels, axis=2).round().clip(0, 255).astype(np.uint8)


@pytest.mark.usefixtures("estimated_once")
def test_the_cameras_of_the_example_are_found(tmp_path):
    copies(tmp_path / "photos")
    assert not has_cameras(tmp_path / "photos")
    assert has_cameras(EXAMPLE)
    with posed_folder(tmp_path / "photos", num_threads=1) as posed:
        posed.save_cameras(tmp_path / "transforms.json")
        assert unread_cameras_notes(tmp_path / "photos") == [] != earlier_estimate_notes(tmp_path / "photos")
        views = read_views(posed.path)
        cameras, names = views.cameras, views.names
        depths = np.concatenate([camera.depths for camera in posed.reconstruction.cameras])
        assert 0 < cameras.near < np.percentile(depths, 1) / 1.4
        assert cameras.far > 1.4 * np.percentile(depths, 99)
    assert not posed.path.exists()
    assert len(names) == 2 and "2 of 2" in posed.notes[0]
    assert "two photographs do not determine their focal length" in posed.warnings[0]  # a rectified stereo pair
    truth = read_transforms_json(EXAMPLE / "transforms.json").photographs
    known = np.linalg.inv(truth[0].camera_to_world) @ truth[1].camera_to_world
    found = np.linalg.inv(cameras.extrinsics[0].numpy()) @ cameras.extrinsics[1].numpy()
    assert rotation_angle(known[:3, :3].T @ found[:3, :3]) < 2 and angle_between(known[:3, 3], found[:3, 3]) < 10
    saved = read_transforms_json(tmp_path / "transforms.json")
    assert [photograph.path.resolve() for photograph in saved.photographs] == [
        (tmp_path / "photos" / path.name).resolve() for path in sorted(PHOTOGRAPHS)
    ]


def test_a_given_focal_length_is_in_pixels_of_the_photographs(tmp_path, monkeypatch):
    monkeypatch.setattr("fecocodec.poses.unposed_photographs.MAX_SIDE_PX", 160)
    for number, size in enumerate(((200, 100), (100, 200))):
        noise(number, size).save(tmp_path / f"{number}.png")
    (tmp_path / "copies").mkdir()
    groups, _ = upright_copies(sorted(tmp_path.glob("*.png")), tmp_path / "copies", 150.0)
    assert [(group.focal_px, group.is_fixed) for group in groups] == [(120.0, True)] * 2


def refusal(folder: Path, focal_px: float | None = None) -> str:
    with pytest.raises(InputError) as refused, posed_folder(folder, num_threads=1, focal_px=focal_px):
        pass
    sentence = str(refused.value)
    assert "\n" not in sentence and sentence.endswith(".")
    return sentence


def noise(seed: int, size: tuple[int, int]) -> Image.Image:
    image = Image.fromarray(np.random.default_rng(seed).integers(0, 256, (30, 40, 3), dtype=np.uint8))
    return image.resize(size, Image.Resampling.BICUBIC)


def give_another_size(first: Path, second: Path) -> None:
    Image.open(second).resize((192, 128)).save(second)


def give_a_name_without_utf8(first: Path, second: Path) -> None:
    try:
        os.rename(first, os.fsencode(first.parent) + b"/K\xfcche.png")
    except OSError:
        pytest.skip("this file system takes UTF-8 names alone")


def replace_by_noise(first: Path, second: Path) -> None:
    for seed, path in enumerate((first, second, first.with_name("zz.png"))):
        noise(seed, (320, 240)).save(path)


@pytest.mark.parametrize(
    ("change", "focal_px", "sentence"),
    [
        (
            lambda *_: None,
            28.0,
            "left.png: a focal length of 28 pixels does not fit its longer side of 384 pixels; give `focal_px` in ",
        ),
        (lambda *_: None, float("nan"), "left.png: a focal length of nan pixels does not fit"),
        (
            give_another_size,
            515.0,
            "right.png: its longer side has 192 pixels and that of left.png 384, so one focal length",
        ),
        (give_a_name_without_utf8, None, "che.png: the name is not UTF-8; rename the file."),
        (replace_by_noise, None, "no camera poses can be estimated (no two photographs have matches); take"),
        (
            lambda first, second: shutil.copy(first, second),
            None,
            "two photographs or more. right.png is left out: it is the same picture as left.png.",
        ),
        (
            lambda first, second: second.unlink() or [(first.parent / name).touch() for name in RAW_AND_ABSENT],
            None,
            ": one photograph without cameras, but cameras are estimated from two or more; add photographs or a "
            "camera file; 1.NEF, 2.NEF are of a kind that cannot be read; develop RAW photographs to JPEG, TIFF or "
            "PNG; .3.jpg.icloud is not here but only linked to, or not downloaded; put the photographs here.",
        ),
    ],
)
def test_photographs_that_are_refused(tmp_path, change, focal_px: float | None, sentence: str):
    change(*copies(tmp_path))
    assert sentence in refusal(tmp_path, focal_px)


RAW_AND_ABSENT = ("1.NEF", "2.NEF", ".3.jpg.icloud")


def test_pycolmap_missing_names_the_extra(tmp_path, monkeypatch):
    copies(tmp_path)
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    assert "pip install '.[poses]'" in refusal(tmp_path)


def test_photographs_are_numbered_in_their_order_with_several_threads(tmp_path):
    """The numbers decide the order of the reconstruction. Plain photographs are ready before the first one."""
    image = np.asarray(Image.open(PHOTOGRAPHS[0]).convert("RGB"))
    names = tuple(f"{number}.png" for number in range(6))
    for number, name in enumerate(names):
        Image.fromarray(image if number % 3 == 0 else np.full_like(image, 40 * number)).save(tmp_path / name)
    pycolmap.Database.open(tmp_path / "database.db").close()
    groups = [ImageGroup(names, 400.0, is_known=False)]
    pycolmap_matching.extract_features(pycolmap, tmp_path / "database.db", tmp_path, groups, num_threads=4)
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        numbers = {entry.name: entry.image_id for entry in database.read_all_images()}
    assert sorted(numbers, key=numbers.__getitem__) == list(names)


@pytest.mark.parametrize("kind", [np.uint16, np.uint8])
def test_copies_of_grey_photographs_of_16_bits_have_their_levels(tmp_path, kind):
    pytest.importorskip("imagecodecs")
    (tmp_path / "copies").mkdir()
    grey = np.asarray(Image.open(PHOTOGRAPHS[0]).convert("L"))
    Image.fromarray(grey.astype(kind) * kind(257 if kind is np.uint16 else 1)).save(tmp_path / "grey.png")
    upright_copies([tmp_path / "grey.png"], tmp_path / "copies")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "copies" / "grey.png")), np.stack([grey] * 3, axis=2))


@pytest.mark.usefixtures("estimated_once")
def test_photographs_that_cannot_be_used_are_left_out_and_named(tmp_path):
    folder = tmp_path / "photos"
    first, _ = copies(folder)
    shutil.copy(first, folder / "same.png")
    (folder / "torn.png").write_bytes(first.read_bytes()[:2000])
    Image.open(first).resize((48, 64)).save(folder / "zz.png")
    for name, data in (("zza.jpg", b""), ("zzb.jpg", b"\n"), ("zzc.tif", b"II*\0\xff\xff\xff\xff")):
        (folder / name).write_bytes(data)
    for name in ("a.DNG", "b.nef", "c.gif", "d.dng", "e.pgm", "left.dng", "._a.dng"):
        (folder / name).write_bytes(b"-")
    for name in ("IMG_1", "b.jpg_large", "left.png_original", "._hidden"):
        shutil.copy(first, folder / name)
    with posed_folder(folder, num_threads=1) as posed:
        assert len(posed.notes) == 1 and "2 of 8" in posed.notes[0]
        (unread, misnamed, *_), (same, torn, small, *no_images) = posed.warnings, posed.omissions
    assert unread == (
        "a.DNG, b.nef, c.gif and 2 more are of a kind that cannot be read; convert them to JPEG, PNG or WebP."
    )
    assert misnamed == (
        "IMG_1, b.jpg_large are not used: by content, but not by name, an image; end such a name in .jpg, .png or "
        ".webp."
    )
    assert same == f"same.png is left out: it is the same picture as {first.name}."
    assert torn.startswith("torn.png is left out: the image is damaged, cut short or of a kind that is not read")
    assert small == "zz.png is left out: 48x64 pixels are too few, sides must be 64 or more."
    assert [sentence.split(" or of")[0] for sentence in no_images] == [
        f"{name} is left out: the image is damaged, cut short" for name in ("zza.jpg", "zzb.jpg", "zzc.tif")
    ]


@pytest.mark.usefixtures("estimated_once")
def test_photographs_that_are_not_here_or_in_other_folders_are_named(tmp_path):
    copies(tmp_path)
    left, right = (path.name for path in PHOTOGRAPHS)
    for name in (f"depth_{left}", "more/a.png", "scan/b/c.png", "masks/d.png", ".cache/e.png", ".c.txt.icloud"):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).touch()
    os.symlink("/nowhere/a.jpg", tmp_path / "a.jpg")
    (tmp_path / ".b.HEIC.icloud").write_bytes(b"bplist00")
    with posed_folder(tmp_path) as posed:
        assert {path.name for path in posed.photographs} == {left, right}
        assert posed.notes[0] == (
            f"images in another folder, or maps by their names, are not used (depth_{left} and 2 more)."
        )
        assert posed.warnings[0] == (
            ".b.HEIC.icloud, a.jpg are not here but only linked to, or not downloaded; put the photographs here."
        )


def test_a_folder_whose_photographs_are_not_here_has_nothing_to_estimate_from(tmp_path):
    (tmp_path / ".b.HEIC.icloud").touch()
    assert has_cameras(tmp_path)
    with pytest.raises(InputError, match=r"\.b\.HEIC\.icloud is not here but only linked to, or not downloaded; put"):
        read_cameras(tmp_path)


@pytest.mark.parametrize("projection", ["ProjectionType='equirectangular'", "ProjectionType>cylindrical<"])
def test_panoramas_are_refused(projection, tmp_path):
    copies(tmp_path)
    with Image.open(PHOTOGRAPHS[0]) as image:
        image.convert("RGB").save(tmp_path / "p.jpg", xmp=f"<rdf:Description GPano:{projection}".encode())
    (tmp_path / "copies").mkdir()
    photographs = sorted(path for path in tmp_path.iterdir() if path.is_file())
    groups, (left_out,) = upright_copies(photographs, tmp_path / "copies")
    kind = projection.split("Type")[1].strip(">='<").upper()
    assert left_out == (
        f"p.jpg is left out: panoramas ({kind}) are not read; cut them into perspective images, as `ns-process-data` "
        "of nerfstudio does for its camera type equirectangular."
    )
    assert "p.jpg" not in [name for group in groups for name in group.names]


def test_exif_data_names_with_spaces_and_an_unrelated_photograph(tmp_path):
    """Focal lengths start from EXIF data, which turn the second one upright; pycolmap's list of pairs has no quotes."""
    for path in (*copies(tmp_path, reduction=2), tmp_path / "zz.png"):
        image = noise(0, (256, 192)) if path.stem == "zz" else Image.open(path).convert("RGB")
        exif = Image.Exif()
        exif.get_ifd(0x8769)[0xA405] = 40  # mm on 35 mm film
        if path.stem == "right":
            exif[0x0112] = 6  # rotate by 90 degrees clockwise to show
            image = image.transpose(Image.Transpose.ROTATE_90)
        image.save(tmp_path / f"# the {path.stem}.jpg", exif=exif, quality=97)
        path.unlink(missing_ok=True)
    with posed_folder(tmp_path, num_threads=1) as posed:
        assert "2 of 3" in posed.notes[0] and "started from EXIF data" in posed.notes[0]
        assert posed.omissions[0].startswith("# the zz.jpg is left out: ")
        views = read_views(posed.path)
    assert views.image_size == (128, 192) and views.names == ("# the left.jpg", "# the right.jpg")


@pytest.mark.parametrize("step", [0.0, 4.0])
def test_a_camera_that_stays_at_one_position_is_refused_before_all_pairs_are_matched(tmp_path, monkeypatch, step):
    monkeypatch.setattr("fecocodec.poses.pose_estimation.read_features", None)  # comes before
    image = np.asarray(Image.open(PHOTOGRAPHS[0]).convert("RGB").reduce(2))
    for index in range(3):
        picture = turned(image, step * index, 0.8 * image.shape[1])
        picture = picture + np.random.default_rng(index).normal(0, 2, image.shape)
        Image.fromarray(picture.round().clip(0, 255).astype(np.uint8)).save(tmp_path / f"{index}.png")
    assert "from one position (a turn of the camera explains their matches), so depth is unknown" in refusal(tmp_path)


@pytest.mark.parametrize("is_found_early", [True, False])
def test_a_full_disk_of_the_temporary_folder_is_one_sentence(tmp_path, monkeypatch, is_found_early):
    """pycolmap aborts the process where its database does not fit."""
    copies(tmp_path / "photos")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    if is_found_early:
        monkeypatch.setattr("fecocodec.atomic.shutil.disk_usage", lambda _: SimpleNamespace(free=1 << 20))
    else:

        def refuse(*_arguments: object, **_options: object) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(Image.Image, "save", refuse)
    needed = ", as 6 MiB are needed" if is_found_early else ""
    with pytest.raises(OutputError) as refused, posed_folder(tmp_path / "photos", num_threads=1):
        pass
    place = f"{tmp_path / 'temporary'}: the disk of the temporary folder is full{needed}"
    assert str(refused.value) == f"{place}; free space, or set TMPDIR to another one."
    assert list((tmp_path / "temporary").iterdir()) == []


def test_outliers_of_some_pixels_do_not_move_the_focal_length():
    """A fifth of the observations of a known scene are off by 3 pixels outwards, as if the lens were longer."""
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 4, 300
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_PINHOLE
    options.camera_params = [1280.0, 512.0, 384.0]
    model = pycolmap.synthesize_dataset(options)
    for image in model.images.values():
        for index in range(0, len(image.points2D), 5):
            point = image.points2D[index]
            offset = point.xy - (512.0, 384.0)
            point.xy = point.xy + 3 * offset / np.linalg.norm(offset)
    focal = refine(pycolmap, model, 4).cameras[1].params[0]
    assert abs(focal / 1280 - 1) < 5e-4


def cameras_at(*positions: tuple[float, float, float], turn: float = 0.0) -> tuple[EstimatedCamera, ...]:
    """Cameras named 0, 1, ... with one orientation; the last one is turned about the vertical axis, in degrees."""
    lens, last = Lens(384, 288, 288.0, 288.0, 192.0, 144.0), len(positions) - 1
    return tuple(camera(str(i), lens, at, turn if i == last else 0.0) for i, at in enumerate(positions))


def test_the_difference_of_two_estimates_ignores_unit_of_length_and_short_baselines():
    first = cameras_at((0, 0, 0), (1, 0, 0), (1.01, 0, 0))
    assert pose_difference(first, cameras_at((0, 0, 0), (3, 0, 0), (3, 0.03, 0))) == pytest.approx((0, 0.57), abs=0.01)
    assert pose_difference(first, cameras_at((0, 0, 0), (3, 0, 0), (3.03, 0, 0), turn=2.5)) == pytest.approx((2.5, 2.5))
    rotation, direction = pose_difference(first, cameras_at((0, 0, 0), (-1, 0, 0), (-1.01, 0, 0)))
    assert (rotation, direction) == pytest.approx((0, 180))
    assert pose_difference(first, cameras_at((0, 0, 0), (1, 0, 0))) is None


def test_cameras_are_in_pixels_of_the_photographs_and_not_of_their_copies(tmp_path: Path) -> None:
    Image.new("RGB", (800, 1200)).save(tmp_path / "0.jpg")
    copy = camera("0", Lens(400, 600, 288.0, 288.0, 200.0, 300.0, (0.1,)))
    found = _of_photograph(copy, tmp_path / "0.jpg")
    assert found.lens == Lens(800, 1200, 576.0, 576.0, 400.0, 600.0, (0.1,))


LONGER = "focal length is 1.60 times the initial one and a second estimate"
MORE = "take a third and a fourth photograph from other positions"


@pytest.mark.parametrize(
    ("found", "focal_px", "reasons"),
    [
        ({"difference": (1.4, 4.9)}, 288.0, ()),
        ({"difference": (1.6, 3.0)}, 288.0, ("differs by up to 1.6 degrees in rotation and 3 degrees in direction",)),
        ({"difference": (0.1, 6.0)}, 288.0, ("differs by up to 0.1 degrees in rotation and 6 degrees in direction",)),
        ({}, 288.0, ("does not find all of them",)),
        ({"difference": (0.1, 0.1)}, 180.0, ()),  # two estimates agree on a long lens
        ({"difference": (1.6, 0.1)}, 180.0, (LONGER, "differs by up to 1.6")),
        ({}, 180.0, (LONGER, "not find all")),
        ({"difference": (0.1, 0.1), "explained": 0.75}, 288.0, ()),
        (
            {"difference": (0.1, 0.1), "explained": 0.74},
            288.0,
            ("they contradict 26% of the matches between two parts of them;",),
        ),
        # Of two photographs, a second estimate is not compared.
        ({"ambiguity": Ambiguity((0.8, 1.25), 14.0)}, 288.0, ()),
        (
            {"ambiguity": Ambiguity((0.7, 1.25), 14.0)},
            288.0,
            ("their focal length here (202 to 360 pixels explain the matches equally well)", MORE),
        ),
        ({"ambiguity": Ambiguity((1.0, 1.0), 16.0)}, 288.0, ("to the second nearly as well (16 degrees away)", MORE)),
    ],
)
def test_uncertain_cameras_give_one_warning(found: dict, focal_px: float, reasons: tuple[str, ...]):
    fields = {"matches": {("0", "1"): 200}, "difference": None} | found
    reconstruction = Reconstruction(cameras_at((0, 0, 0), (1, 0, 0)), 0.3, 8.0, **fields)
    warnings = reliability_warnings(reconstruction, [ImageGroup(("0", "1"), focal_px, is_known=False)], 288.0)
    assert len(warnings) == (1 if reasons else 0)
    for warning in warnings:
        assert warning.startswith("the cameras may be wrong: ") and warning.endswith(".")
        assert [warning.count(reason) for reason in reasons] == [1] * len(reasons)


def test_the_warning_of_a_given_focal_length_does_not_ask_for_it():
    found = Reconstruction(cameras_at((0, 0, 0), (1, 0, 0)), 0.3, 8.0, {("0", "1"): 200}, (2.0, 3.0))
    (warning,) = reliability_warnings(found, [ImageGroup(("0", "1"), 288.0, is_known=False, is_fixed=True)], 288.0)
    assert "a second estimate from another initial pair differs" in warning and "EXIF" not in warning


class Model:
    """A reconstruction of four photographs with points of two observations each."""

    def __init__(self, num_points: int) -> None:
        track = type("Track", (), {"length": lambda self: 2})()
        self.points3D = {index: type("Point", (), {"track": track})() for index in range(num_points)}
        self.cameras: dict[int, object] = {}

    def num_reg_images(self) -> int:
        return 4


def test_looser_attempts_follow_until_most_matches_are_explained(tmp_path, monkeypatch):
    """A reconstruction of all photographs from few of their matches is usually wrong."""
    models = iter([{0: Model(6)}, {}, {0: Model(66)}, {0: Model(90)}])
    steps = {"incremental_mapping": lambda *_arguments: next(models), "set_random_seed": lambda _seed: None}
    mapper = type("Mapper", (), {name: staticmethod(step) for name, step in steps.items()})
    monkeypatch.setattr(pycolmap_steps, "_mapping_options", lambda *_arguments: None)
    attempts = ((8.0, 60, 24),) * 4
    best = pycolmap_steps.map_photographs(mapper, tmp_path / "d.db", tmp_path, tmp_path / "maps", attempts, 100, 4)
    assert len(best.points3D) == 66
    assert len(list(models)) == 1


@pytest.mark.parametrize(
    ("matches", "reason"),
    [
        ({}, "no two photographs have matches"),
        ({("a", "b"): 16, ("b", "c"): 19}, "b and c have the most matches, 19, but 20 are needed"),
        # Pairs without matches are no reason where others have enough.
        ({("a", "b"): 138}, "the matches do not determine camera positions, as if the camera only turned"),
    ],
)
def test_why_nothing_is_estimated_is_said(matches: dict[tuple[str, str], int], reason: str) -> None:
    assert obstacle(Reconstruction((), 0.0, 0.0, matches, None)) == reason


def test_features_under_masks_are_not_used(tmp_path):
    paths = copies(tmp_path / "photos", reduction=2)
    width, height = Image.open(paths[0]).size
    mask = Image.new("L", (width, height), 255)
    mask.paste(0, (0, 0, width // 3, height))
    (tmp_path / "photos" / "masks").mkdir()
    mask.save(tmp_path / "photos" / "masks" / paths[0].name)
    with posed_folder(tmp_path / "photos", num_threads=1, focal_px=257.8) as posed:
        keypoints = keypoints_of(posed.path)
        ignored = read_views(posed.path).ignored
    assert ignored is not None and ignored[0, :, : width // 3].all() and not ignored[1].any()
    assert keypoints[paths[0].name].min() > width / 3 - 1 > keypoints[paths[1].name].min()
    with posed_folder(tmp_path / "photos", num_threads=1, focal_px=257.8, has_masks=False) as posed:
        assert keypoints_of(posed.path)[paths[0].name].min() < width / 4
        assert read_views(posed.path).ignored is None


def keypoints_of(folder: Path) -> dict[str, np.ndarray]:
    """Return the columns of the features of each photograph."""
    return {name: points[:, 0] for name, points in read_points(pycolmap, folder / ".colmap" / "database.db").items()}


def test_many_large_photographs_have_the_same_features_in_less_time(tmp_path, monkeypatch):
    """Where the photograph without enlargement gives too few features, it is enlarged as a small one."""
    sharp = Image.open(PHOTOGRAPHS[0]).convert("L")
    sharp.save(tmp_path / "sharp.png")
    sharp.filter(ImageFilter.GaussianBlur(12)).save(tmp_path / "blurred.png")
    groups = [ImageGroup(("blurred.png", "sharp.png"), 400.0, is_known=False)]
    monkeypatch.setattr(pycolmap_matching, "_MANY", 2)
    monkeypatch.setattr(pycolmap_matching, "_MOST_FEATURES_OF_MANY", 200)
    found = []
    for least in (1 << 30, 1):
        monkeypatch.setattr(pycolmap_matching, "_LARGE", least)
        database = tmp_path / f"{least}.db"
        pycolmap.Database.open(database).close()
        pycolmap_matching.extract_features(pycolmap, database, tmp_path, groups, 1)
        found.append(read_points(pycolmap, database))
    enlarged, fast = found
    assert np.array_equal(enlarged["blurred.png"], fast["blurred.png"])
    nearest = np.linalg.norm(enlarged["sharp.png"][:, None] - fast["sharp.png"], axis=2).min(axis=0)
    assert len(nearest) >= 200
    assert 0 < np.median(nearest) < 0.5 and (nearest < 1.0).mean() > 0.8


@pytest.mark.parametrize("is_upright", [False, True])
def test_masks_are_turned_with_their_photographs(is_upright, tmp_path):
    """A mask has the pixels of the photograph as stored, or as shown."""
    exif = Image.Exif()
    exif[0x0112] = 6  # shown turned clockwise
    Image.new("RGB", (128, 96), "grey").save(tmp_path / "a.jpg", exif=exif)
    mask = Image.new("L", (128, 96), 255)
    mask.paste(0, (0, 0, 32, 96))
    (tmp_path / "masks").mkdir()
    (mask.transpose(Image.Transpose.ROTATE_270) if is_upright else mask).save(tmp_path / "masks" / "a.png")
    (tmp_path / "copies").mkdir()
    upright_copies([tmp_path / "a.jpg"], tmp_path / "copies")
    found = Image.open(upright_masks([tmp_path / "a.jpg"], tmp_path / "copies") / "a.jpg.png")
    assert found.size == (96, 128)
    assert np.array_equal(np.asarray(found)[:32] > 0, np.zeros((32, 96), bool)) and np.asarray(found)[32:].min() == 255


def test_why_a_photograph_is_left_out_is_said() -> None:
    """Many matches do not help where few of them lead to points that the others determine, and few may be enough."""
    matches = {("0", "a"): 29, ("0", "b"): 138, ("1", "c"): 138, ("a", "e"): 200}
    cameras = cameras_at((0, 0, 0), (1, 0, 0))
    found = Reconstruction(cameras, 0.3, 8.0, matches, None, reached={"a": 16, "b": 11, "c": 96})
    assert _left_out([Path(name) for name in "01abcde"], found) == [
        "d is left out: no matches with another photograph; take it again with more overlap.",
        "b, e are left out, with 0 to 11 points whose position the others determine; add photographs that show the "
        "same parts (a camera needs 12 such points).",
        "a, c are left out: no camera fits the 16 to 96 points whose position the others determine; something moved, "
        "or parts look alike.",
    ]
    (single,) = _left_out([Path(name) for name in "01e"], found)
    assert single.startswith("e is left out, with no points whose position the others determine; add photographs")
    (several,) = _left_out([Path(name) for name in "01df"], found)
    assert several == "d, f are left out: no matches with another photograph; take them again with more overlap."
    assert _left_out([Path(name) for name in "01"], found) == []


def test_a_lens_without_inverse_is_an_estimate_that_failed() -> None:
    """One usable photograph is too few; others of another lens are left out later."""
    wrong, right = Lens(640, 480, 517.0, 517.0, 320.0, 240.0, (-3.0,)), Lens(640, 480, 517.0, 517.0, 320.0, 240.0)
    cameras = [camera(name, wrong if name == "a" else right, (turn, 0.0, 0.0)) for turn, name in enumerate("abc")]
    require_usable("photos", Reconstruction(tuple(cameras), 0.02, 3.7, {}, None))
    failed = Reconstruction(tuple(cameras[:2]), 0.02, 3.7, {}, None)
    with pytest.raises(
        InputError, match=r"photos: the cameras that .* wrong .* give their focal length by `focal_px`, or"
    ):
        require_usable("photos", failed)
    with pytest.raises(InputError, match="with texture, or give known cameras"):
        require_usable("photos", failed, is_focal_given=True)
