"""Weights files and checkpoints that are damaged or hostile end in an error of ours."""

import dataclasses
import math
import os
import shutil
from pathlib import Path

import pytest
import torch

import fecocodec
from fecocodec.checkpoint import RECEIVER_FILE, SHIPPED, Weights, config_of, find_receiver
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.errors import ModelError
from fecocodec.training.run_files import load_checkpoint


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("synthesis_depth", 10**9),
        ("synthesis_depth", 0),
        ("state_channels", -1),
        ("predictor_channels", [176, 10**9]),
        ("neighbour_fade", math.nan),
        ("largest_gain", math.inf),
        ("largest_gain", -1.0),
    ],
)
def test_a_configuration_out_of_range_is_refused(name: str, value: object) -> None:
    stored = dataclasses.asdict(ReceiverConfig()) | {name: value}
    with pytest.raises(ModelError, match=f"file: {name} in its configuration is out of range; reinstall the package"):
        config_of(Weights({}, {"receiver": stored}, b""), "receiver", ReceiverConfig(), Path("file"))


@pytest.mark.parametrize("config", [ReceiverConfig(), SenderConfig()])
def test_this_version_s_configurations_are_in_range(config: object) -> None:
    stored = {name: list(v) if isinstance(v, tuple) else v for name, v in dataclasses.asdict(config).items()}
    assert config_of(Weights({}, {"end": stored}, b""), "end", config, Path("file")) == config


def test_the_folder_of_a_model_may_be_text(tmp_path: Path) -> None:
    vector = Path(__file__).parent.parent / "bitstream_spec" / "vectors" / "valid" / "scene-compact-6.fcs"
    shutil.copytree(SHIPPED / "compact-6", tmp_path / "copy")
    assert fecocodec.decode(vector.read_bytes(), model=str(tmp_path / "copy")).gaussians.count > 0


@pytest.mark.parametrize(
    "content",
    [None, b"", b"PK\x03\x04", b"\x80\x02.", b"\x80\x02K\x01.", b"cos\nsystem\n.", 3, [1, 2], torch.zeros(2)],
)
def test_a_checkpoint_that_is_none(tmp_path: Path, content: object) -> None:
    """A file with these bytes, or with this value as torch saves it, or none."""
    path = tmp_path / "last.pt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        torch.save(content, path)
    with pytest.raises(ModelError, match=r"last\.pt: not a training checkpoint"):
        load_checkpoint(path)


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "sparse"])
def test_weights_that_are_no_regular_file_of_moderate_size_are_not_read(kind: str, tmp_path: Path) -> None:
    """Reading a pipe blocks, and reading a device or a sparse file fills the memory."""
    path = tmp_path / RECEIVER_FILE
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    else:
        path.touch()
        os.truncate(path, 1 << 40)
    reason = {
        "folder": "cannot be read .Is a directory.; name the folder of a model",
        "sparse": "have 1099511627776 bytes, but at most",
    }
    with pytest.raises(ModelError, match=reason.get(kind, "cannot be read .a pipe or a device.")):
        find_receiver(b"no model", tmp_path)
