"""Folders of scenes for batches: of text, and of photographs."""

from collections.abc import Callable
from pathlib import Path

import pytest

from fecocodec.batch.scenes import BatchScene, scene_folders
from tests.example_scenes import write_scene

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
