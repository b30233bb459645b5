"""The command line in this process, and a small stream that needs no network to be described."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from fecosplat_cli.main import run

from fecocodec.container import Header, PackedCameras, Stream, write_stream

IDENTITY_POSE = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
SHIFTED_POSE = (1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str


CommandLine = Callable[..., Result]


@pytest.fixture
def fecosplat(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """Call `fecosplat(*arguments)` as a terminal would."""

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
    )
    cameras = PackedCameras((IDENTITY_POSE, SHIFTED_POSE), ((1.0, 1.75, 0.5, 0.5),) * 2, near=1.0, far=10.0)
    return write_stream(Stream(header, cameras, (b"first payload", b"second")))


@pytest.fixture
def stream_file(tmp_path: Path, stream_bytes: bytes) -> Path:
    file = tmp_path / "scene.fcs"
    file.write_bytes(stream_bytes)
    return file
