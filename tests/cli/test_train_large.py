"""The paper's larger variant from the command line: training with a frozen extractor, and encoding."""

from pathlib import Path

import pytest

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.config import PAPER_RECEIVER, PaperSenderConfig
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import load_codec, serialise_sender
from fecocodec.sender.model import Sender
from tests.chunk_files import write_wall_chunks
from tests.cli.conftest import CommandLine
from tests.sender.depthsplat_base.public_base_network import write_checkpoint
from tests.wall_scene import shots, write_transforms

CONFIG = ("--config", "paper-dl3dv-large")
SMALL = ("--size", "64x64", "--views", "2", "--targets", "1", "--precision", "float32", "--threads", "1")


@pytest.mark.parametrize("given", [0, 2])
def test_the_checkpoint_must_be_given_once(fecosplat: CommandLine, tmp_path: Path, given: int) -> None:
    arguments = ["--extractor-weights", str(tmp_path)] * given
    result = fecosplat("train", tmp_path / "run", *CONFIG, "--photographs", tmp_path, *arguments)
    assert result.code == 1 and result.err.count("\n") == 1
    assert "is frozen; give DepthSplat-Base's file by --extractor-weights, once." in result.err


def write_small_model(folder: Path) -> Path:
    """An untrained model of paper-dl3dv."""
    data = serialise_receiver(Receiver(PAPER_RECEIVER))
    folder.mkdir()
    (folder / RECEIVER_FILE).write_bytes(data)
    sender = Sender(PaperSenderConfig(PAPER_RECEIVER.synthesis_channels), PAPER_RECEIVER)
    (folder / SENDER_FILE).write_bytes(serialise_sender(sender, model_id_of(data)))
    return folder


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_it_trains_and_encodes_from_the_command_line(
    fecosplat: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two steps, of which the second resumes; then a folder of photographs is coded with the exported model."""
    monkeypatch.setattr(
        "fecocodec.training.graphs.export.export_receiver", lambda folder, on_progress: None
    )  # takes minutes
    checkpoint, model = write_checkpoint(tmp_path / "base.pth"), tmp_path / "model"
    chunks = write_wall_chunks(tmp_path / "chunks", num_scenes=2, num_frames=4)
    start = write_small_model(tmp_path / "small")
    arguments = ["train", tmp_path / "run", *CONFIG, "--photographs", chunks, *SMALL, "--from", start]
    first = fecosplat(*arguments, "--extractor-weights", checkpoint, "--steps", "1")
    assert first.code == 0 and "125,719,574 in all" in first.err
    assert "743 tensors used, 1 unused, 0 missing" in first.err
    other = write_checkpoint(tmp_path / "other.pth", seed="other")
    changed = fecosplat(*arguments, "--extractor-weights", other, "--steps", "2")
    assert changed.code == 1 and "other.pth: the run began with another extractor" in changed.err
    second = fecosplat(*arguments, "--extractor-weights", checkpoint, "--steps", "2", "--export", model)
    assert second.code == 0, second.err
    assert (model / SENDER_FILE).stat().st_size < 10e6

    write_transforms(tmp_path / "wall", shots(2), near=1.0, far=20.0)
    stream, scene = tmp_path / "wall.fcs", tmp_path / "wall.ply"
    encode = ["encode", tmp_path / "wall", "--size", "64x64", "--model", model, "--threads", "1"]
    encoded = fecosplat(*encode, "-o", stream)
    assert encoded.code == 0, encoded.err
    assert fecosplat("decode", stream, "-o", scene, "--model", model).code == 0
    checkpoint.unlink()
    load_codec.cache_clear()
    absent = fecosplat(*encode, "-o", tmp_path / "again.fcs")
    assert absent.code == 1 and absent.err.count("fecosplat: ") == 1
    assert "needs the weights of its extractor, base.pth" in absent.err
