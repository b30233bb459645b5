"""The commands and Python snippets of docs/paper_profile.md run as printed, on tiny data and without a GPU."""

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from click import Context
from fecosplat_cli.command_line import command_line

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import adapted_sender, serialise_sender
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender
from fecocodec.training.batch import BatchShapes
from fecocodec.training.configurations import RunSettings, configuration_named
from fecocodec.training.loop import train
from fecocodec.training.model_weights import export_networks
from fecocodec.training.sources import open_sources
from fecocodec.training.trainer import Trainer
from tests.chunk_files import record, write_chunks, write_wall_chunks
from tests.sender.depthsplat_base.public_base_network import constant_weights, shapes_at_8
from tests.wall_scene import shots, write_transforms

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs/paper_profile.md").read_text()
BLOCKS: list[tuple[str, str]] = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
SNIPPETS = [text for language, text in BLOCKS if language == "python"]
LAUNCHER = "torchrun --nproc-per-node 4 -m fecosplat_cli "
# These follow the options of the page, and the last one counts: sizes as the page says, and what a small machine needs.
SMALL_TRAINING = "--device cpu --steps 2 --size 64x64 --targets 1 --threads 1 --precision float32"
SMALL_EVALUATION = "--device cpu --size 64x64 --lambdas 1e-3 --threads 1"


def printed_commands() -> list[str]:
    """Return every command of the page's blocks, with continued lines joined."""
    blocks = [text for language, text in BLOCKS if not language]
    lines = [line for text in blocks for line in text.replace("\\\n", " ").splitlines()]
    return [line for line in lines if not line.startswith("#")]


COMMANDS = printed_commands()


def arguments_of(command: str) -> list[str]:
    """Return the words after `fecosplat`, or after torchrun and its options."""
    assert command.startswith((LAUNCHER, "fecosplat "))
    return shlex.split(command.removeprefix(LAUNCHER).removeprefix("fecosplat "))


def test_the_page_has_commands_and_snippets() -> None:
    assert len(COMMANDS) == 8 and len(SNIPPETS) == 1


@pytest.mark.parametrize("command", COMMANDS)
def test_arguments_are_accepted(command: str) -> None:
    name, *arguments = arguments_of(command)
    found = command_line.get_command(Context(command_line), name)
    assert found is not None
    found.make_context(name, arguments)  # raises for an unknown option or a value of another kind


def write_model(folder: Path, name: str) -> None:
    """Untrained networks of a configuration, as `--export` writes them."""
    configuration = configuration_named(name)
    receiver = Receiver(configuration.receiver)
    data = serialise_receiver(receiver)
    folder.mkdir(parents=True)
    (folder / RECEIVER_FILE).write_bytes(data)
    sender = Sender(configuration.sender, configuration.receiver)
    (folder / SENDER_FILE).write_bytes(serialise_sender(sender, model_id_of(data)))


def write_videos(folder: Path, num_frames: int, url: str = "https://video.example/watch?v=0") -> Path:
    wall = record("", shots(num_frames), url=url)
    return write_chunks(folder, [[wall | {"key": f"wall{number}"} for number in range(2)]])


@pytest.mark.timeout(300)
def test_the_snippet_runs_and_its_extractor_trains_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Views are small. Training has two steps of four views."""
    write_transforms(tmp_path / "scenes/wall", shots(4), near=1.0, far=20.0)
    (tmp_path / "index.json").write_text(json.dumps({"wall": {"context": [0, 3], "target": [1]}}))
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(SNIPPETS[0].replace("(256, 256)", "(64, 64)"), names)
    assert names["decoded"].gaussians.count > 0
    assert re.match(r"Measurement\(entry='wall', .* num_bytes=\d+.* psnr=", capsys.readouterr().out)

    chunks = write_videos(tmp_path / "dl3dv/train", 10)
    write_model(tmp_path / "weights/paper-dl3dv", "paper-dl3dv")
    large = configuration_named("paper-dl3dv-large")
    small = replace(
        large,
        schedule=replace(large.schedule, num_steps=2),
        shapes=BatchShapes(1, ((4, 1.0),), 1, ((64, 64),)),
        precision="float32",
    )
    sender = adapted_sender(names["MyExtractor"](), small.receiver)
    settings = RunSettings(tmp_path / "run", small, None)
    trainer = Trainer(settings, open_sources(chunks, None, small), sender)
    trainer.start_from(tmp_path / "weights/paper-dl3dv")
    assert [row["step"] for row in train(trainer)] == [2]
    export_networks(trainer.checkpoint, tmp_path / "weights/paper-dl3dv-large", trainer.receiver, trainer.sender)
    assert (tmp_path / "weights/paper-dl3dv-large" / SENDER_FILE).exists()


def write_data(folder: Path) -> None:
    """Everything that the commands read, under the names of the page."""
    for name in ("re10k", "acid"):
        for split in ("train", "test"):
            write_wall_chunks(folder / name / split, num_scenes=2, num_frames=4)
        index = {"wall0": {"context": [0, 3], "target": [1]}, "wall1": None}
        (folder / f"evaluation_index_{name}.json").write_text(json.dumps(index))
    for split in ("train", "test"):
        write_videos(folder / "dl3dv" / split, 10, url="1f0e06e4388dd600")
    (folder / "dl3dv_8_views.json").write_text(json.dumps({"wall1": {"context": [*range(8)], "target": [8]}}))
    (folder / "others.csv").write_text("system,setting,kib,psnr\nCodecSplat,a,8.0,20.0\n")
    tensors = {f"encoder.depth_predictor.{name}": value for name, value in DepthSplatSmall().state_dict().items()}
    for name in set(re.findall(r"depthsplat-gs-small-[\w-]+\.pth", PAGE)):
        torch.save(tensors, folder / name)
    (large,) = set(re.findall(r"depthsplat-gs-base-[\w-]+\.pth", PAGE))
    torch.save(constant_weights(shapes=shapes_at_8()), folder / large)
    write_transforms(folder / "scenes" / "wall", shots(4), near=1.0, far=20.0)
    (folder / "fecocodec").symlink_to(ROOT / "fecocodec")


def small_command(command: str) -> list[str]:
    """Return the words of a command with small sizes; two processes in place of four, and one worker each."""
    name, *arguments = arguments_of(command)
    if name == "eval":
        return [sys.executable, "-m", "fecosplat_cli", name, *arguments, *SMALL_EVALUATION.split()]
    small = SMALL_TRAINING.split()
    small += ["--workers", "1"] if "--workers" in arguments else []
    small += ["--views", "2"] if arguments[arguments.index("--config") + 1] == "compact" else []
    python = [sys.executable, "-m"]
    if command.startswith(LAUNCHER):
        python += ["torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m"]
    return [*python, "fecosplat_cli", name, *arguments, *small]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_commands_run_in_the_order_of_the_page(tmp_path: Path) -> None:
    write_data(tmp_path)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    for command in COMMANDS:
        result = subprocess.run(small_command(command), cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert result.returncode == 0, command + result.stderr[-3000:]
    models = ("paper-re10k", "paper-dl3dv", "paper-large", "deep", "compact-deep")
    assert all((tmp_path / "weights" / model / SENDER_FILE).exists() for model in models)
    tables = [(tmp_path / "results" / name / "complexity.md").read_text() for name in ("re10k", "acid", "dl3dv")]
    assert all("CodecSplat" in text and "fecosplat" in text for text in tables)
    deep, compact = ((tmp_path / "weights" / name / RECEIVER_FILE).read_bytes() for name in ("deep", "compact-deep"))
    assert deep == compact == (ROOT / "fecocodec/weights/compact-6" / RECEIVER_FILE).read_bytes()
