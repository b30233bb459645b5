"""`encode` of photographs without cameras, `decode` to other formats, and the preview."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

from fecocodec.camera_files.transforms_json import read_transforms_json
from fecocodec.container import inspect
from fecocodec.photographs.image_headers import read_image_size

EXAMPLE = Path(__file__).parents[2] / "examples" / "motorcycle"
FAST = ("--size", "96x64", "--stages", "1", "--effort", "fast")
pytestmark = pytest.mark.usefixtures("estimated_once")
pytest.importorskip("pycolmap")


@pytest.fixture
def unposed(tmp_path: Path) -> Path:
    return Path(shutil.copytree(EXAMPLE / "images", tmp_path / "photos"))


def test_photographs_without_cameras_are_encoded_previewed_and_decoded(fecosplat, unposed, tmp_path) -> None:
    stream, cameras = tmp_path / "scene.fcs", tmp_path / "estimated.json"
    text = ("--title", "Motorcycle", "--author", "A. B.", "--licence", "CC0", "--date", "2014-01-02")
    result = fecosplat("encode", unposed, "-o", stream, *FAST, "--save-cameras", cameras, *text)
    assert result.code == 0, result.err
    assert "\nnote: cameras estimated for 2 of 2 photographs" in f"\n{result.err}"
    assert "warning: the cameras may be wrong: two photographs do not determine their focal length" in result.err
    summary = inspect(stream.read_bytes())
    assert summary.header.num_views == 2
    assert summary.metadata == {"title": "Motorcycle", "author": "A. B.", "licence": "CC0", "date": "2014-01-02"}
    assert {photograph.path.resolve().parent for photograph in read_transforms_json(cameras).photographs} == {
        unposed.resolve()
    }

    assert fecosplat("render", stream, "-o", tmp_path / "preview.webp").code == 0
    assert read_image_size(tmp_path / "preview.webp") == (64, 96)

    for name in ("scene.compressed.ply", "scene.spz", "scene.sog", "scene.glb"):
        coded = tmp_path / f"{name}.json"
        result = fecosplat("decode", stream, "-o", tmp_path / name, "--frame", "first-camera", "--save-cameras", coded)
        assert result.code == 0, result.err
        first = json.loads(coded.read_text())["frames"][0]["transform_matrix"]
        assert first[0] == pytest.approx([1, 0, 0, 0], abs=1e-6)
        assert (tmp_path / name).stat().st_size > 1000


def test_saved_cameras_encode_to_the_same_bytes_from_another_folder(fecosplat, unposed, tmp_path, monkeypatch) -> None:
    """The photographs are links in a linked folder; the paths are relative to the folder of the camera file."""
    store, other = tmp_path / "store", tmp_path / "far" / "away"
    unposed.rename(store)
    other.mkdir(parents=True)
    (tmp_path / "real").mkdir()
    for index, photograph in enumerate(sorted(store.iterdir())):
        (tmp_path / "real" / f"{index}.png").symlink_to(photograph)
    (tmp_path / "photos").symlink_to(tmp_path / "real")
    monkeypatch.chdir(tmp_path)
    cameras = Path("far/away/transforms.json")
    assert fecosplat("encode", "photos", "-o", "a.fcs", *FAST, "--save-cameras", cameras).code == 0
    files = [frame["file_path"] for frame in json.loads(cameras.read_text())["frames"]]
    assert files == ["../../real/0.png", "../../real/1.png"]

    monkeypatch.chdir(other)
    for number, source in enumerate((Path("transforms.json"), Path())):
        output = tmp_path / f"again{number}.fcs"
        result = fecosplat("encode", source, "-o", output, *FAST)
        assert result.code == 0, result.err
        assert output.read_bytes() == (tmp_path / "a.fcs").read_bytes()


def test_strict_refuses_estimated_cameras_that_may_be_wrong_and_given_ones_that_are_not_read(
    fecosplat, unposed, tmp_path
) -> None:
    arguments = ("encode", unposed, "-o", tmp_path / "a.fcs", "--save-cameras", tmp_path / "cameras.json", *FAST)
    result = fecosplat(*arguments, "--strict", "-q")
    assert result.code == 1
    assert result.err.startswith(f"fecosplat: {unposed}: the cameras may be wrong: two photographs do not determine")
    assert result.err.endswith(" (--strict makes this warning an error).\n") and result.err.count("\n") == 1
    (unposed / "cameras.xml").write_text("<document><chunk>")
    result = fecosplat(*arguments, "--strict", "-q")
    assert (result.code, list(tmp_path.iterdir())) == (1, [unposed])
    assert result.err == (
        f"fecosplat: {unposed}: cameras in cameras.xml (Metashape) are not read, and cameras are estimated; to use "
        "them, convert them to a transforms.json or a COLMAP model (--strict makes this warning an error).\n"
    )


def test_saved_cameras_of_a_video_name_no_temporary_files(fecosplat, tmp_path: Path) -> None:
    video, cameras = tmp_path / "clip.mkv", tmp_path / "cameras.json"
    write_clip(video)
    result = fecosplat("encode", video, "-o", tmp_path / "a.fcs", *FAST, "--frames", "2", "--save-cameras", cameras)
    assert result.code == 0, result.err
    assert "the frames of the video are not saved" in result.err
    files = [frame["file_path"] for frame in json.loads(cameras.read_text())["frames"]]
    assert files == ["frame000000.png", "frame000001.png"]


def test_saved_frames_of_a_video_encode_to_the_same_scene(fecosplat, tmp_path: Path) -> None:
    video, frames, cameras = tmp_path / "photographs" / "clip.mkv", tmp_path / "frames", tmp_path / "cameras.json"
    video.parent.mkdir()
    write_clip(video)
    saved = ("--save-frames", frames, "--save-cameras", cameras)
    result = fecosplat("encode", video, "-o", tmp_path / "a.fcs", *FAST, *saved)
    assert result.code == 0, result.err
    assert "cameras estimated for 2 of 2 frames:" in result.err and "two frames do not determine" in result.err
    assert "photograph" not in result.err and "are not saved" not in result.err
    assert {path.name for path in frames.iterdir()} == {"frame000000.png", "frame000001.png", "transforms.json"}
    files = [frame["file_path"] for frame in json.loads(cameras.read_text())["frames"]]
    assert files == ["frames/frame000000.png", "frames/frame000001.png"]
    for number, source in enumerate((frames, cameras)):
        again = tmp_path / f"again{number}.fcs"
        assert fecosplat("encode", source, "-o", again, *FAST).code == 0
        assert again.read_bytes() == (tmp_path / "a.fcs").read_bytes()

    before = sorted(tmp_path.iterdir())
    files = ("-o", tmp_path / "b.fcs", "--save-frames", tmp_path / "other")
    result = fecosplat("encode", video, *files, *FAST, "--strict", "-q")
    assert result.code == 1 and f"{video}: the cameras may be wrong: two frames do not" in result.err
    assert sorted(tmp_path.iterdir()) == before


def test_frames_are_saved_to_a_new_folder(fecosplat, unposed: Path, tmp_path: Path) -> None:
    video = tmp_path / "clip.mkv"
    write_clip(video)
    result = fecosplat("encode", video, "-o", tmp_path / "a.fcs", "--save-frames", unposed)
    assert result.code == 1 and f"{unposed}: this exists and is no empty folder; choose another" in result.err
    assert sorted(tmp_path.iterdir()) == [video, unposed]


def write_clip(path: Path) -> None:
    """Write the two photographs of the example as a lossless video of two frames."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=1)
        images = [Image.open(file).convert("RGB") for file in sorted((EXAMPLE / "images").iterdir())]
        stream.width, stream.height = images[0].size
        stream.pix_fmt = "bgr0"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_image(image)))
        container.mux(stream.encode())


def test_a_given_focal_length_is_used(fecosplat, unposed: Path, tmp_path: Path) -> None:
    result = fecosplat("encode", unposed, "-o", tmp_path / "a.fcs", "--focal-px", "28")
    assert result.code == 1
    assert "give --focal-px in pixels of the photographs, not in millimetres.\n" in result.err


def test_videos_beside_photographs_and_cameras_in_the_folder_above_are_named(fecosplat, tmp_path: Path) -> None:
    scene = Path(shutil.copytree(EXAMPLE, tmp_path / "scene"))
    (scene / "images" / "clip.mp4").touch()
    result = fecosplat("encode", scene / "images", "-o", tmp_path / "a.fcs", *FAST)
    assert result.code == 0, result.err
    assert "note: videos beside photographs are not used (clip.mp4); give one itself to use it.\n" in result.err
    warning = f"warning: {scene / 'transforms.json'} has cameras, and cameras are estimated; to use them instead, give "
    assert f"{warning}the folder {scene}.\n" in result.err


def test_a_batch_records_estimated_cameras_as_a_note_and_their_doubt_as_a_warning(
    fecosplat, networks, tmp_path, output
):
    shutil.copytree(EXAMPLE / "images", tmp_path / "scenes" / "pair")
    result = fecosplat("batch", "encode", tmp_path / "scenes", "-o", output, "--shard", "1/1", *FAST)
    assert result.code == 0, result.err
    sidecar = json.loads((output / "pair.fcs.json").read_text())
    (note,) = sidecar["details"]["notes"]
    assert note.startswith("cameras estimated for 2 of 2 photographs: ")
    assert sidecar["warnings"][0].startswith("the cameras may be wrong: two photographs do not determine")
    assert not any("cameras estimated" in warning for warning in sidecar["warnings"])
