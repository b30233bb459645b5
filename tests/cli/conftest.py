"""The command line in this process, and a small stream that needs no network to be described."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
import torch.nn.functional as functional
from fecosplat_cli.main import run

import fecocodec
from fecocodec import model_files
from fecocodec.container import Header, PackedCameras, Stream, write_stream
from fecocodec.photographs.images import write_image
from tests.example_scenes import MODEL

IDENTITY_POSE = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
SHIFTED_POSE = (1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str


CommandLine = Callable[..., Result]


@pytest.fixture
def fecosplat(found_once: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> CommandLine:
    """Call `fecosplat(*arguments)` as a terminal would, without lines of progress, which a slow machine would print."""
    monkeypatch.setattr("fecosplat_cli.progress.SECONDS_BETWEEN_LINES", float("inf"))

    def call(*arguments: object) -> Result:
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Result(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def stream_bytes() -> bytes:
    """Two views of 448x256 whose payloads are not decodable, but framed as they must be."""
    header = Header(
        model_id=b"no model",
        num_views=2,
        height=256,
        width=448,
        lambda_q=1179,
        symbol_digests=(b"digest 1", b"digest 2"),
        first_stage_excess=229,
    )
    cameras = PackedCameras((IDENTITY_POSE, SHIFTED_POSE), ((1.0, 1.75, 0.5, 0.5),) * 2, near=1.0, far=10.0)
    return write_stream(Stream(header, cameras, (b"first payload", b"second")))


@pytest.fixture
def stream_file(tmp_path: Path, stream_bytes: bytes) -> Path:
    file = tmp_path / "scene.fcs"
    file.write_bytes(stream_bytes)
    return file


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of four 96x64 photographs of a textured wall, taken side by side, with cameras and depth bounds."""
    folder = tmp_path_factory.mktemp("photographs")
    wall = functional.interpolate(
        torch.rand(1, 3, 12, 24, generator=torch.Generator().manual_seed(7)), size=(64, 128), mode="bicubic"
    )[0].clamp(0, 1)
    frames = []
    for view in range(4):
        name = f"view_{view}.png"
        write_image(folder / name, wall[:, :, 8 * view : 8 * view + 96])
        pose = [[1, 0, 0, 0.25 * view], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        frames.append({"file_path": name, "transform_matrix": pose})
    scene = {"w": 96, "h": 64, "fl_x": 96.0, "fl_y": 96.0, "near": 1.5, "far": 6.0, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(scene))
    return folder


@pytest.fixture
def networks(random_weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands work with untrained networks instead of the shipped ones."""
    monkeypatch.setattr(model_files, "SHIPPED", random_weights)
    monkeypatch.setattr(model_files, "DEFAULT_MODEL", MODEL)


@pytest.fixture(scope="session")
def wall(photographs: Path, random_weights: Path) -> bytes:
    """A stream of two photographs, coded by the untrained networks."""
    views = fecocodec.read_views(photographs, views=(0, 1))
    return fecocodec.encode(views, effort="fast", model=random_weights / MODEL)


@pytest.fixture
def wall_file(networks: None, wall: bytes, tmp_path: Path) -> Path:
    """`wall` as a file, for commands that work with the untrained networks."""
    file = tmp_path / "wall.fcs"
    file.write_bytes(wall)
    return file
