"""Images with other names or folders than in the camera file are found; those that are not there are passed over."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from wall_scene import (
    edited,
    shots,
    write_cameras_json,
    write_colmap_binary,
    write_colmap_text,
    write_llff,
    write_realestate10k,
    write_transforms,
)

from fecocodec.camera_files.find import read_cameras
from fecocodec.camera_files.image_matching import similar_key
from fecocodec.captures.chosen_photographs import ChosenPhotographs, choose_photographs
from fecocodec.captures.render_cameras import read_render_cameras
from fecocodec.captures.view_selection import All, Auto, Spread
from fecocodec.errors import InputError

Write = Callable[..., Path]
WRITERS = [write_transforms, write_colmap_text, write_colmap_binary, write_realestate10k, write_cameras_json]
NAMED_BY_FILE = [write_transforms, write_colmap_text, write_colmap_binary]  # with suffix
RENAMED = "2 of 2 images have another name or folder than in "


def image_of(folder: Path, name: str) -> Path:
    return next(path for path in (folder / "images" / name, folder / name) if path.exists())


def rename_in_cameras(folder: Path, change: Callable[[str], str]) -> None:
    """Change the names of images in the camera file of any format, whose images are 000.png, 001.png, ..."""
    for path in folder.rglob("*"):
        if path.suffix == ".json":
            scene = json.loads(path.read_text())
            for frame in scene["frames"]:
                frame["file_path"] = change(frame["file_path"].removeprefix("images/"))
            path.write_text(json.dumps(scene))
        elif path.name == "images.txt":
            lines = [line.rpartition(" ") for line in path.read_text().splitlines()]
            named = [(head, change(name) if name.endswith(".png") else name) for head, _, name in lines]
            path.write_text("\n".join(f"{head} {name}" for head, name in named) + "\n")
        elif path.name == "images.bin":
            data = path.read_bytes()
            for number in range(9):
                data = data.replace(f"{number:03d}.png\0".encode(), f"{change(f'{number:03d}.png')}\0".encode())
            path.write_bytes(data)


def poses_of(chosen: ChosenPhotographs) -> list[np.ndarray]:
    return [photograph.camera_to_world for photograph in chosen.photographs]


def assert_all_found(folder: Path, count: int = 2) -> ChosenPhotographs:
    """The cameras belong to their images: those of `shots`, in the order of the names of the files."""
    chosen = choose_photographs(folder)
    assert chosen.notes == ()
    assert [photograph.path.is_file() for photograph in chosen.photographs] == [True] * count
    by_file = sorted(chosen.photographs, key=lambda photograph: photograph.path.name)
    expected = [shot.camera_to_world for shot in shots(count)]
    np.testing.assert_allclose([photograph.camera_to_world for photograph in by_file], expected, atol=1e-6)
    return chosen


@pytest.mark.parametrize(
    ("named", "stored"),
    [
        ("a%20b {}", "a b {}"),
        ("a b {}", "a%20b {}"),
        ("a b {}", "a\u202fb {}"),
        ("{} ", "{}"),
        ("{}\r\n", "{}"),
        ("\u00e9te\u0301 {}", "e\u0301t\u00e9 {}"),  # macOS stores e with an accent as two characters
    ],
)
def test_names_as_urls_and_in_other_characters(named: str, stored: str, tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    rename_in_cameras(folder, lambda name: f"images/{named.format(name)}")
    for image in [*(folder / "images").iterdir()]:
        image.rename(image.with_name(stored.format(image.name)))
    assert assert_all_found(folder).remarks[0].startswith(RENAMED)
    assert len(choose_photographs(folder, views=(named.format("001.png"),)).names) == 1


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("missing", ["000.png", "001.png"])
def test_missing_images_are_passed_over_with_one_note(write: Write, missing: str, tmp_path: Path) -> None:
    folder = write(tmp_path / "scene", shots(4))
    image_of(folder, missing).unlink()
    chosen = choose_photographs(folder)
    assert chosen.names == tuple(name for name in ("000.png", "001.png", "002.png", "003.png") if name != missing)
    (note,) = chosen.notes
    assert note.startswith("1 of 4 images that ") and missing.removesuffix(".png") in note
    assert note.endswith("put it there to use it.")
    assert chosen.remarks == ()
    for selection in (Auto(), Spread(2), All()):
        chosen = choose_photographs(folder, views=selection)
        assert len(chosen.names) >= 1 and missing not in chosen.names
        assert chosen.notes[0] == note
    named = choose_photographs(folder, views=(3, 2))
    assert (named.names, named.notes) == (("003.png", "002.png"), ())
    place = rf"{missing[:3]}(\.png)?; put it there or leave this view out by `views`\.$"
    with pytest.raises(InputError, match=f": there is no image {folder}/.*{place}"):
        choose_photographs(folder, views=(int(missing[:3]),))
    with pytest.raises(InputError, match="4 views asked for, but the folder has 3; choose 1 to 3"):
        choose_photographs(folder, views=Spread(4))


def test_all_missing_images_are_counted_and_named(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(30))
    for number in range(3, 28):
        (folder / "images" / f"{number:03d}.png").unlink()
    (note,) = choose_photographs(folder).notes
    names = ", ".join(f"images/{number:03d}.png" for number in range(3, 23))
    assert note == (
        "25 of 30 images that transforms.json names are missing and are passed over "
        f"({names} and 5 more); put them there to use them."
    )
    with pytest.raises(InputError, match=r"003\.png, and of 2 images 2 are missing in all; put them"):
        choose_photographs(folder, views=(3, 4))


def test_names_of_files_in_a_locale_that_is_not_utf8(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.fsencode", lambda name: name.encode("iso-8859-1"))
    assert similar_key("K\xc3\xbcche.jpg") == similar_key("K\xfcche.jpg") == "k\xfcche.jpg"
    assert similar_key("\u53f0.jpg") == "\u53f0.jpg"


@pytest.mark.parametrize("kind", ["bin", "txt"])
def test_names_of_colmap_that_are_not_utf8_are_those_of_files(kind: str, tmp_path: Path) -> None:
    folder = (write_colmap_binary if kind == "bin" else write_colmap_text)(tmp_path / "scene", shots(2))
    try:
        for image in [*(folder / "images").iterdir()]:
            image.rename(os.fsdecode(os.fsencode(image).replace(b"001", b"0\xfc1")))
    except OSError:
        pytest.skip("this file system takes UTF-8 names alone")
    table = folder / "sparse" / "0" / f"images.{kind}"
    table.write_bytes(table.read_bytes().replace(b"001.png", b"0\xfc1.png"))
    assert_all_found(folder)


def test_a_folder_beside_with_the_images_is_named(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    (folder / "images").rename(folder / "rgb")
    with pytest.raises(InputError) as error:
        choose_photographs(folder)
    assert str(error.value).endswith(f"; put the images there (one of this name is {folder / 'rgb' / '000.png'}).")


@pytest.mark.parametrize("write", WRITERS)
def test_no_image_at_all(write: Write, tmp_path: Path) -> None:
    folder = write(tmp_path / "scene", shots(2))
    for image in [*folder.rglob("*.png")]:
        image.unlink()
    with pytest.raises(
        InputError, match=r": there is no image .*, nor any other that .* names; put the images there\."
    ):
        choose_photographs(folder)


@pytest.mark.parametrize("write", NAMED_BY_FILE)
@pytest.mark.parametrize(
    "change",
    [
        lambda name: name.upper(),
        lambda name: name.replace(".png", ".PNG"),
        lambda name: name.replace(".png", ".jpg"),
        lambda name: name.replace(".png", ".HEIC"),
        lambda name: f"/home/me/scan/images/{name}",
        lambda name: f"C:\\Users\\me\\scan\\images\\{name}",
        lambda name: f"scan\\{name}",
        lambda name: f"Images/{name}",
    ],
)
def test_other_names_and_folders(write: Write, change: Callable[[str], str], tmp_path: Path) -> None:
    folder = write(tmp_path / "scene", shots(2))
    rename_in_cameras(folder, change)
    chosen = assert_all_found(folder)
    cameras, images = ("transforms.json", "images/") if write is write_transforms else ("sparse/0", "")
    used = f"{images}000.png is used for {change('000.png')}, and so on."
    assert chosen.remarks == (f"{RENAMED}{cameras}: {used}",)
    assert choose_photographs(folder, views=(change("001.png"),)).names == ("001.png",)


@pytest.mark.parametrize("write", NAMED_BY_FILE)
def test_spaces_are_kept(write: Write, tmp_path: Path) -> None:
    folder = write(tmp_path / "scene", shots(2))
    for name in ("000.png", "001.png"):
        (folder / "images" / name).rename(folder / "images" / f"my  photo {name}")
    rename_in_cameras(folder, lambda name: f"my  photo {name}")
    chosen = assert_all_found(folder)
    assert chosen.names == ("my  photo 000.png", "my  photo 001.png")


@pytest.mark.parametrize("write", NAMED_BY_FILE)
def test_a_backslash_can_belong_to_a_name(write: Write, tmp_path: Path) -> None:
    """So it does where an archive of Windows was unpacked elsewhere."""
    folder = write(tmp_path / "scene", shots(2))
    for name in ("000.png", "001.png"):
        image = image_of(folder, name)
        image.rename(image.with_name(f"s\\{name}"))
    rename_in_cameras(folder, lambda name: f"s\\{name}")
    assert assert_all_found(folder).names == ("s\\000.png", "s\\001.png")


def test_a_mask_beside_the_camera_file_of_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder `.` has no name."""
    folder = write_transforms(tmp_path, shots(2))
    shutil.copy(folder / "images" / "000.png", folder / "a_mask.png")
    with edited(folder) as scene:
        scene["frames"][0]["mask_path"] = "a_mask.png"
    monkeypatch.chdir(folder)
    assert [photograph.mask for photograph in read_cameras(".").photographs] == [Path("a_mask.png"), None]


def test_ambiguous_names_are_no_match(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    image = folder / "images" / "000.png"
    shutil.copy(image, image.with_name("b.PNG"))
    image.rename(image.with_name("B.png"))
    rename_in_cameras(folder, lambda name: {"000.png": "images/b.png"}.get(name, f"images/{name}"))
    chosen = choose_photographs(folder)
    assert chosen.names == ("001.png",)
    assert chosen.notes[0].startswith(
        "1 of 2 images that transforms.json names is missing and is passed over (images/b.png)"
    )


def test_two_names_do_not_share_one_image(tmp_path: Path) -> None:
    """A rig with one folder a camera, of which only one was copied, without its folder."""
    folder = write_transforms(tmp_path / "scene", shots(2))
    names = {"000.png": "cam1/0001.png", "001.png": "cam2/0001.png"}
    rename_in_cameras(folder, names.__getitem__)
    (folder / "images" / "000.png").rename(folder / "images" / "0001.png")
    (folder / "images" / "001.png").unlink()
    with pytest.raises(InputError, match="there is no image"):
        choose_photographs(folder)


def test_names_without_suffix_are_not_found_by_their_beginning(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(3))
    rename_in_cameras(folder, lambda name: f"images/frame.{name.removesuffix('.png')}")
    for number in (0, 1):
        (folder / "images" / f"{number:03d}.png").rename(folder / "images" / f"frame.{number:03d}.png")
    chosen = choose_photographs(folder)
    assert (chosen.names, len(chosen.notes)) == (("frame.000.png", "frame.001.png"), 2)  # 002.png has no camera


@pytest.mark.parametrize("write", [*WRITERS, write_llff])
@pytest.mark.parametrize("reduced", ["images_2", "images_4", "input"])
def test_reduced_folders_are_used_with_scaled_cameras(write: Write, reduced: str, tmp_path: Path) -> None:
    factor = int(reduced.removeprefix("images_") if "_" in reduced else 1)
    taken = shots(2, width=384, height=320, fx=400.0, fy=400.0, cx=192.0, cy=160.0)
    folder = write(tmp_path / "scene", taken)
    whole = choose_photographs(folder)
    (folder / reduced).mkdir()
    for image in [image_of(folder, name) for name in ("000.png", "001.png")]:
        with Image.open(image) as photograph:
            photograph.resize((384 // factor, 320 // factor)).save(folder / reduced / image.name)
        image.unlink()
    chosen = choose_photographs(folder)
    assert chosen.names == ("000.png", "001.png") and chosen.notes == ()
    assert chosen.image_size == (320 // factor, 384 // factor)
    np.testing.assert_allclose(chosen.intrinsics, whole.intrinsics)
    assert len(chosen.remarks) == 1 and reduced in chosen.remarks[0]


def test_a_reduced_folder_tells_the_size_that_the_camera_file_leaves_out(tmp_path: Path) -> None:
    folder = write_transforms(
        tmp_path / "scene", shots(2, width=384, height=320, fx=400.0, fy=400.0, cx=192.0, cy=160.0)
    )
    whole = choose_photographs(folder)
    (folder / "images").rename(folder / "images_4")
    for image in (folder / "images_4").iterdir():
        with Image.open(image) as photograph:
            photograph.resize((96, 80)).save(image)
    with edited(folder) as scene:
        for frame in scene["frames"]:
            del frame["w"], frame["h"]
    chosen = choose_photographs(folder)
    np.testing.assert_allclose(chosen.intrinsics, whole.intrinsics)


def test_the_folder_with_most_images_is_used(tmp_path: Path) -> None:
    folder = write_realestate10k(tmp_path / "scene", shots(4))
    (folder / "clip").mkdir()
    for name in ("000.png", "001.png", "003.png"):
        shutil.copy(folder / name, folder / "clip" / name)
    assert {photograph.path.parent for photograph in choose_photographs(folder).photographs} == {folder}
    (folder / "002.png").unlink()
    (folder / "003.png").unlink()
    chosen = choose_photographs(folder)
    assert [photograph.path.parent.name for photograph in chosen.photographs] == ["clip"] * 3


def test_same_names_in_subfolders_stay_apart(tmp_path: Path) -> None:
    folder = write_colmap_binary(tmp_path / "scene", shots(3))
    rename_in_cameras(folder, lambda name: f"cam{int(name[:3]) % 2}/{int(name[:3]) // 2:04d}.png")
    for number in range(3):
        camera = folder / "images" / f"cam{number % 2}"
        camera.mkdir(exist_ok=True)
        (folder / "images" / f"{number:03d}.png").rename(camera / f"{number // 2:04d}.png")
    chosen = choose_photographs(folder)
    assert chosen.names == ("cam0/0000.png", "0001.png", "cam1/0000.png")
    assert (chosen.notes, chosen.remarks) == ((), ())
    assert choose_photographs(folder, views=chosen.names).names == chosen.names
    with pytest.raises(InputError, match=r"2 views are called 0000\.png; give more of its path"):
        choose_photographs(folder, views=("0000.png",))


def test_copies_and_hidden_files_are_left_out(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(3))
    (folder / "images" / "._000.png").write_bytes(b"\0\5\26\7")
    assert choose_photographs(folder).notes == ()
    shutil.copy(folder / "images" / "000.png", folder / "images" / "001.png")
    chosen = choose_photographs(folder)
    assert chosen.names == ("000.png", "002.png")
    assert chosen.notes == ("001.png is left out: it is a copy of 000.png; remove it, or choose both by `views`.",)
    assert choose_photographs(folder, views=(0, 1)).names == ("000.png", "001.png")
    assert choose_photographs(folder, views=All()).names == ("000.png", "002.png")


@pytest.mark.parametrize("again", ["images/000.png", "./images/../images/000.png"])
def test_a_second_camera_of_an_image_is_passed_over(tmp_path: Path, again: str) -> None:
    folder = write_transforms(tmp_path / "scene", shots(3))
    rename_in_cameras(folder, lambda name: again if "1" in name else f"images/{name}")
    (folder / "images" / "001.png").unlink()
    chosen = choose_photographs(folder)
    assert chosen.names == ("000.png", "002.png")
    (note,) = chosen.notes
    assert note.startswith(f"1 of 3 cameras of transforms.json is passed over ({again}): another frame has")


def test_a_rig_whose_model_leaves_out_the_folders_is_never_matched_in_silence(tmp_path: Path) -> None:
    """Two cameras, each with a folder of images with the same names."""
    folder = write_colmap_binary(tmp_path / "scene", shots(4))
    rename_in_cameras(folder, lambda name: f"000{int(name[:3]) % 2}.png")
    images = folder / "images"
    for number in range(4):
        camera = images / f"cam{number // 2}"
        camera.mkdir(exist_ok=True)
        (images / f"{number:03d}.png").rename(camera / f"000{number % 2}.png")
    with pytest.raises(InputError) as refused:
        choose_photographs(folder)
    assert str(refused.value) == (
        f"{folder}/sparse/0, image 0000.png: there is no image {images}/0000.png, nor any other that sparse/0 names; "
        f"2 have this name, as {images}/cam0/0000.png and {images}/cam1/0000.png; name each with its folder."
    )
    for image in (images / "cam1").iterdir():
        shutil.copy(image, images)
    assert choose_photographs(folder).notes == (
        "2 of 4 cameras of sparse/0 are passed over (0000.png, 0001.png): another frame has this image, too, and its "
        "camera is used; name the image of each with its folder, or remove one.",
    )


def spoil_pose(folder: Path, number: int, value: object) -> None:
    with edited(folder) as scene:
        scene["frames"][number]["transform_matrix"] = value


@pytest.mark.parametrize(
    ("pose", "cause"),
    [
        (None, "no `transform_matrix`; add the pose of its camera, or remove the frame."),
        (
            [[1, 0, 0, float("inf")], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
            "transform_matrix: a camera value is NaN or infinite; correct it or take this view out of the file.",
        ),
        ([[0] * 4] * 4, "the last row of the pose is not 0 0 0 1; export camera-to-world matrices."),
    ],
)
def test_a_camera_without_a_valid_pose_matters_only_if_it_is_named(pose: object, cause: str, tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(4))
    spoil_pose(folder, 0, pose)
    assert choose_photographs(folder, views=(1, 2)).notes == ()
    note = f"1 of 4 cameras of transforms.json is passed over (images/000.png): {cause}"
    for selection in (None, Auto(), Spread(2), All()):
        chosen = choose_photographs(folder, views=selection)
        assert "000.png" not in chosen.names and chosen.notes[0] == note
    rendered = read_render_cameras(folder)
    assert rendered.names == ("001", "002", "003") and rendered.notes == (note,)
    for read in (choose_photographs, read_render_cameras):
        with pytest.raises(InputError, match="frame 0 "):
            read(folder, views=(0, 1))


def test_cameras_that_cannot_be_used_are_counted_by_cause(tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(5))
    spoil_pose(folder, 0, None)
    spoil_pose(folder, 2, None)
    with edited(folder) as scene:
        scene["frames"][3]["camera_model"] = "EQUIRECTANGULAR"
    first, second = choose_photographs(folder).notes
    assert first.startswith(
        "2 of 5 cameras of transforms.json are passed over (images/000.png, images/002.png): no `tr"
    )
    assert second.startswith("1 of 5 cameras of transforms.json is passed over (images/003.png): panoramas (EQUIRECT")


def test_a_camera_model_of_colmap_matters_only_if_it_is_named(tmp_path: Path) -> None:
    folder = write_colmap_text(tmp_path / "scene", shots(3))
    table = folder / "sparse" / "0" / "cameras.txt"
    table.write_text(table.read_text().replace("2 OPENCV", "2 FOV"))
    chosen = choose_photographs(folder)
    assert chosen.names == ("000.png", "002.png")
    (note,) = chosen.notes
    assert note.startswith("1 of 3 cameras of sparse/0 is passed over (001.png): camera model FOV is not supported;")
    with pytest.raises(InputError, match=r"image 001\.png: camera model FOV is not supported"):
        choose_photographs(folder, views=(1,))
