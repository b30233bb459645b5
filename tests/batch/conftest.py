"""Folders of scenes for batches: of text, and of photographs."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from fecocodec.batch.scenes import BatchScene, scene_folders
from fecocodec.photographs.images import write_image
from tests.example_scenes import example_views

MakeScenes = Callable[..., tuple[BatchScene, ...]]


@pytest.fixture
def texts(tmp_path: Path) -> MakeScenes:
    """A function that makes one scene for each `name=text`."""

    def make(**content: str) -> tuple[BatchScene, ...]:
        for name, text in content.items():
            (tmp_path / "scenes" / name).mkdir(parents=True, exist_ok=True)
            (tmp_path / "scenes" / name / "text").write_text(text)
        return scene_folders(tmp_path / "scenes")

    return make


@pytest.fixture(scope="session")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with four scenes of two photographs of 64x64 pixels, with cameras."""
    root = tmp_path_factory.mktemp("photographed") / "scenes"
    for number in range(4):
        write_scene(root / f"scene_{number}", seed=number)
    return root


def write_scene(folder: Path, seed: int) -> None:
    folder.mkdir(parents=True)
    views = example_views(2, seed=seed)
    frames = []
    for view, image in enumerate(views.images):
        write_image(folder / f"{view}.png", image)
        pose = views.cameras.extrinsics[view].clone()
        pose[:, 1:3] *= -1  # OpenCV to OpenGL axes
        frames.append({"file_path": f"{view}.png", "transform_matrix": pose.tolist()})
    scene = {"w": 64, "h": 64, "fl_x": 57.6, "fl_y": 57.6, "near": 1.5, "far": 12.0, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(scene))


@pytest.fixture
def output(tmp_path: Path) -> Path:
    """An empty folder to write to."""
    folder = tmp_path / "output"
    folder.mkdir()
    return folder
