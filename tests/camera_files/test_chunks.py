"""Chunks of RealEstate10K, ACID and DL3DV: views whose cameras agree with their pixels, and refusals."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.camera_files.chunks import DL3DV_BOUNDS, VIDEO_BOUNDS, ChunkFolder, is_chunk_folder
from fecocodec.errors import InputError
from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.geometry.views import Views
from tests.chunk_files import record, write_chunks, write_wall_chunks
from tests.wall_scene import shots, wall_colour


def wall_error(views: Views) -> float:
    """Mean difference between the images and what their cameras say the wall looks like."""
    rays = camera_to_world_points(views.cameras, pixel_rays(views.cameras, *views.image_size)).double().numpy()
    centres = views.cameras.extrinsics[:, :3, 3].double().numpy()
    expected = np.stack([wall_colour(c, ray - c) for c, ray in zip(centres, rays, strict=True)])
    return float(np.abs(views.images.permute(0, 2, 3, 1).numpy() - expected).mean())


@pytest.mark.parametrize("size", [(80, 96), (64, 64), (64, 90)])
def test_cameras_agree_with_the_pixels(tmp_path: Path, size: tuple[int, int]) -> None:
    chunks = ChunkFolder(write_wall_chunks(tmp_path))
    views = chunks.scene("wall2").views((2, 0), size=size)
    assert views.image_size == size and views.names == ("2:66000", "0:0")
    assert wall_error(views) < 0.01
    taken = shots(3)
    torch.testing.assert_close(
        views.cameras.extrinsics.double(), torch.from_numpy(np.stack([taken[i].camera_to_world for i in (2, 0)])),
        atol=1e-6, rtol=0,
    )  # fmt: skip


def test_bounds_follow_the_data_set(tmp_path: Path) -> None:
    write_chunks(tmp_path, [[record("video", shots(2)), record("capture", shots(2), url="1f0e06e4388dd600")]])
    chunks = ChunkFolder(tmp_path)
    video, capture = (chunks.scene(name).views((0, 1), size=(64, 64)).cameras for name in ("video", "capture"))
    assert (video.near, video.far) == VIDEO_BOUNDS and (capture.near, capture.far) == DL3DV_BOUNDS


def test_many_chunks_are_opened_one_after_the_other(tmp_path: Path) -> None:
    chunks = ChunkFolder(write_wall_chunks(tmp_path, num_scenes=12, num_frames=1))
    assert chunks.scene_names == tuple(f"wall{number}" for number in range(12))
    for name in (*chunks.scene_names, "wall0"):
        assert len(chunks.scene(name)) == 1 and chunks.scene(name).name == name


def test_a_chunk_folder_is_told_from_other_folders(tmp_path: Path) -> None:
    assert is_chunk_folder(write_wall_chunks(tmp_path / "chunks", num_scenes=1))
    (tmp_path / "index.json").write_text("{}")
    assert not is_chunk_folder(tmp_path)


class Harmful:
    """Pickles to a call that leaves a file behind."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return (Path.touch, (self.path,))


def test_a_chunk_that_would_run_code_is_refused_and_runs_nothing(tmp_path: Path) -> None:
    witness = tmp_path / "witness"
    write_chunks(tmp_path, [[record("wall", shots(1)) | {"url": Harmful(witness)}]])
    with pytest.raises(InputError, match=r"000000\.torch: the chunk is damaged, or holds more than tensors and text"):
        ChunkFolder(tmp_path).scene("wall")
    (tmp_path / "000000.torch").write_bytes(pickle.dumps(Harmful(witness)))
    with pytest.raises(InputError, match=r"000000\.torch: this is no chunk as torch.save writes it"):
        ChunkFolder(tmp_path).scene("wall")
    assert not witness.exists()


def test_damaged_chunks_are_one_sentence(tmp_path: Path) -> None:
    path = write_wall_chunks(tmp_path, num_scenes=1) / "000000.torch"
    whole = path.read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 30):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"000000\.torch: .*fetch it again\.$"):
            ChunkFolder(tmp_path).scene("wall0")
    rng = np.random.default_rng(0)
    for position in rng.integers(0, min(3000, len(whole)), 40):  # the pickle stands first
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 0x5A]) + whole[position + 1 :])
        try:
            ChunkFolder(tmp_path).scene("wall0").views((0, 2), size=(64, 64))
        except InputError as error:
            assert str(path) in str(error)
    path.unlink()
    with pytest.raises(InputError, match="no such chunk; download or convert"):
        ChunkFolder(tmp_path).scene("wall0")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"images": "none"}, "`images` is no list of encoded images"),
        ({"timestamps": torch.arange(5)}, "`timestamps` is not one whole number an image"),
        ({"cameras": [1, 2]}, "`cameras` is no tensor"),
        ({"cameras": torch.zeros(3, 12)}, "cameras: 3x18 numbers expected, 3x12 numbers found"),
        ({"cameras": torch.full((3, 18), float("nan"))}, "a camera value is NaN or infinite"),
        ({"cameras": torch.zeros(3, 18)}, "a focal length is not positive"),
        ({"cameras": torch.ones(3, 18)}, "camera 0: the pose is singular"),
        ({"images": [torch.zeros(9, dtype=torch.uint8)] * 3}, "image 0: the image is damaged"),
    ],
)
def test_bad_records_name_file_scene_and_fault(tmp_path: Path, changes: dict, sentence: str) -> None:
    write_chunks(tmp_path, [[record("wall", shots(3)) | changes]])
    with pytest.raises(InputError) as refusal:
        ChunkFolder(tmp_path).scene("wall").views((0,), size=(64, 64))
    assert str(refusal.value).startswith(f"{tmp_path / '000000.torch'}, scene wall") and sentence in str(refusal.value)


def test_frames_that_cannot_be(tmp_path: Path) -> None:
    scene = ChunkFolder(write_wall_chunks(tmp_path, num_scenes=1)).scene("wall0")
    with pytest.raises(InputError, match=r"scene wall0: there is no frame \[3\]; choose from 0 to 2"):
        scene.views((0, 3), size=(64, 64))


@pytest.mark.parametrize(
    ("index", "sentence"),
    [
        ("{", "line 1, column 2: broken JSON"),
        ("[]", "no object of scene to chunk"),
        (json.dumps({"a": "../outside.torch"}), "scene a is not in a file beside the index"),
        (json.dumps({"a": 3}), "scene a is not in a file beside the index"),
    ],
)
def test_bad_indices(tmp_path: Path, index: str, sentence: str) -> None:
    (tmp_path / "index.json").write_text(index)
    with pytest.raises(InputError, match=sentence):
        ChunkFolder(tmp_path)


def test_scenes_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"index\.json: cannot be read .*give a folder of chunks"):
        ChunkFolder(tmp_path)
    chunks = ChunkFolder(write_wall_chunks(tmp_path, num_scenes=1))
    with pytest.raises(InputError, match="has no scene hall; check that the index is for this split"):
        chunks.scene("hall")
    torch.save([], tmp_path / "000000.torch")
    with pytest.raises(InputError, match=r"has no scene wall0, though index\.json says so"):
        ChunkFolder(tmp_path).scene("wall0")
