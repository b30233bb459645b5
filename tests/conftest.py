"""Tests run with annotated types and tensor shapes of the library checked, see `tests/checked_calls.py`.

Property tests draw the same examples in every run: a commit passes or fails, not both.
Threads of OpenMP sleep while they wait: beside other processes of tests, spinning ones take six times as long.
Files whose functions numba compiles are left out: a check wrapped around a kernel could not be compiled.
"""

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import jaxtyping
import pytest
from hypothesis import settings

from tests import checked_calls

if TYPE_CHECKING:
    from fecocodec.sender.codec import Codec

os.environ.setdefault("GOMP_SPINCOUNT", "0")  # read when torch is loaded
LIBRARY = Path(__file__).resolve().parent.parent / "fecocodec"
USES_NUMBA = re.compile(r"^(import numba|from numba import|from fecocodec\.kernels\.compilation import)", re.MULTILINE)
# Files whose tests take longest. They run first, so that no process of `make test` waits for another one at the end.
LONG_FILES = {
    "test_shipped_weights.py",
    "test_round_trip.py",
    "test_latent_optimisation.py",
    "test_decoding_anywhere.py",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in LONG_FILES)


def checked_modules() -> list[str]:
    files = (file for file in LIBRARY.rglob("*.py") if file.name != "__init__.py")
    return [
        ".".join(file.relative_to(LIBRARY.parent).with_suffix("").parts)
        for file in files
        if not USES_NUMBA.search(file.read_text())
    ]


settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
jaxtyping.jaxtyped = checked_calls.jaxtyped
jaxtyping.install_import_hook(checked_modules(), "beartype.beartype")


def pytest_runtest_setup() -> None:
    checked_calls.forget_calls()


@pytest.fixture(scope="session")
def random_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of weights with one model, `tests.example_scenes.MODEL`: networks as they are before training."""
    from tests.example_scenes import write_random_model

    folder = tmp_path_factory.mktemp("weights")
    write_random_model(folder)
    return folder


@pytest.fixture
def output(tmp_path: Path) -> Path:
    """An empty folder to write to."""
    folder = tmp_path / "output"
    folder.mkdir()
    return folder


@pytest.fixture
def estimated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cameras of the same two photographs are estimated once a process."""
    from tests.estimated_once import estimated_once

    monkeypatch.setattr("fecocodec.poses.posed_folder.reconstruct", estimated_once)


@pytest.fixture
def found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Corners and depths of the same photographs are found once a process."""
    from tests.found_once import corners_once, depths_once

    monkeypatch.setattr("fecocodec.geometry.depth_range._consistent_depths", depths_once)
    monkeypatch.setattr("fecocodec.geometry.sparse_matches.find_corners", corners_once)
    monkeypatch.setattr("fecocodec.sender.input_warnings.find_corners", corners_once)


@pytest.fixture(scope="session")
def codec(random_weights: Path) -> "Codec":
    """The networks of `random_weights`, which no test changes."""
    from fecocodec.sender.codec import load_codec
    from tests.example_scenes import MODEL

    return load_codec(random_weights / MODEL, "cpu")


@pytest.fixture(scope="session")
def shipped_codec() -> "Codec":
    """The networks that ship, which no test changes."""
    from fecocodec.checkpoint import model_folder
    from fecocodec.sender.codec import load_codec

    return load_codec(model_folder(None), "cpu")
