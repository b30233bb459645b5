"""`fecosplat train`: options over configurations, and one sentence for what cannot be trained.

`fecosplat info --parameters`: the paper's profiles at the paper's size.
"""

import json
import os
import signal
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from fecosplat_cli.train import command
from fecosplat_cli.train_options import overridden

from fecocodec.model_files import DEFAULT_MODEL, SHIPPED
from fecocodec.sender.distortion import PerceptualDistortion
from fecocodec.training.configurations import CONFIGURATIONS, Configuration
from fecocodec.training.trainer import Trainer
from tests.chunk_files import write_wall_chunks
from tests.cli.conftest import CommandLine
from tests.sender.depthsplat_base.public_base_network import PARAMETERS

PAPER = ("--config", "paper-re10k", "--photographs", ".")


def parsed(*arguments: str) -> Configuration:
    """The configuration that these options of `train` lead to."""
    values = command.make_context("train", ["folder", *arguments]).params
    return overridden(CONFIGURATIONS[values["name"]], values)


def test_without_options_a_configuration_is_taken_as_it_is() -> None:
    for name, configuration in CONFIGURATIONS.items():
        assert parsed("--config", name) == configuration
    assert parsed() == CONFIGURATIONS["compact"]


def test_options_override_the_configuration_and_nothing_else() -> None:
    found = parsed(
        "--views", "2", "--size", "128x128", "--scenes", "3", "--steps", "70", "--photograph-share", "0", "0.5"
    )
    assert found.shapes.view_shares == ((2, 1.0),) and found.shapes.sizes == ((128, 128),)
    assert (found.shapes.num_scenes, found.shapes.num_target) == (3, 2)
    assert (found.schedule.num_steps, found.schedule.photograph_share) == (70, (0.0, 0.5))
    assert found.schedule.learning_rate == CONFIGURATIONS["compact"].schedule.learning_rate
    several = parsed("--views", "2:0.9,4:.1", "--size", "160x96", "--size", "128x64", "--lambda-range", "1e-4", "1e-3")
    assert several.shapes.view_shares == ((2, 0.9), (4, 0.1))
    assert several.shapes.sizes == ((96, 160), (64, 128))
    assert several.lambda_range == (1e-4, 1e-3)
    assert parsed(*PAPER).distortion == PerceptualDistortion("lpips")
    for name in ("lpips", "st-lpips", "none"):
        found = parsed(*PAPER, "--perceptual", name)
        assert found.distortion == PerceptualDistortion(name)
        assert replace(found, distortion=PerceptualDistortion()) == CONFIGURATIONS["paper-re10k"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--size", "100x128"], "A training image side of 100 pixels cannot be used; choose a multiple of 32 from 64"),
        (["--config", "large"], "There is no training configuration 'large'; choose one of compact"),
        (["--config", "paper-re10k"], "trains on photographs alone, but there are none; give --photographs."),
        (["--views", "40"], "40 context views with share 1 cannot be trained; give 1 to 16"),
        (["--scenes", "0"], "give at least one of each"),
        (["--steps", "0"], "A schedule of 0 steps"),
        (["--learning-rate", "-1"], "The learning rate is -1; it must be positive."),
        (["--photograph-share", "0", "2"], "The share of photographs is (0.0, 2.0); give two numbers from 0 to 1."),
        (["--depth-weight", "nan", "1"], "give two numbers of 0 or more."),
        (["--lambda-range", "1e-3", "1e-4"], "The range of lambda goes from 0.001 down; give the smaller end first."),
        (["--perceptual-weight", "5", *PAPER], "D + lambda R and ignores --perceptual-weight; leave them out."),
        (["--depth-weight", "1", "0", "--optimised-share", "0.5", *PAPER], "a network that proposes steps"),
        (["--perceptual", "lpips"], "no LPIPS; leave out --perceptual, or weigh ST-LPIPS by --perceptual-weight."),
        (["--depth-weight", "1", "0", *PAPER], "D + lambda R and ignores --depth-weight; leave them out."),
        (["--lambda-range", "1e-9", "1e-4"], "lambda is 1e-09, outside the range of the codec"),
        (["--photographs", "nowhere"], "nowhere: there is no such file or folder"),
        (["--photographs", str(Path(__file__).parent)], "cli: no scene folders with transforms.json"),
        (["--textures", "nowhere"], "nowhere: there is no such file or folder"),
        (["--from", "nowhere"], "nowhere: there is no such file or folder"),
        (["--from", str(Path(__file__).parent)], "the weights cannot be read"),
        (["--device", "cuda:7"], "device cuda:7 was asked for"),
        (["--export", str(SHIPPED / DEFAULT_MODEL)], "compact-6: this folder holds a model already; choose another"),
    ],
)
def test_what_cannot_be_trained_is_one_sentence(
    fecosplat: CommandLine, tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    folder = tmp_path / "run"
    result = fecosplat("train", folder, *arguments)
    assert result.code == 1 and result.out == ""
    assert sentence in result.err and result.err.count("\n") == 1
    assert not folder.exists()


def test_a_run_is_resumed_with_its_own_options_alone(
    fecosplat: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is interrupted after a step, and saves a checkpoint."""
    step = Trainer.train_step

    def interrupted(trainer: Trainer) -> dict[str, float]:
        os.kill(os.getpid(), signal.SIGINT)
        return step(trainer)

    first = ("train", tmp_path, "--steps", "2", "--views", "2", "--size", "64x64", "--scenes", "1", "--seed", "1")
    with monkeypatch.context() as patched:
        patched.setattr(Trainer, "train_step", interrupted)
        result = fecosplat(*first)
    assert result.code == 130 and result.err.endswith("fecosplat: interrupted\n")
    chunks = write_wall_chunks(tmp_path / "chunks", num_scenes=2, num_frames=4)
    for option, value in (("--seed", "2"), ("--size", "96x64"), ("--photographs", chunks)):
        other = fecosplat(*first, option, value)
        assert other.code == 1 and other.err.count("\n") == 1
        assert f"last.pt: this run began with another {option}; give the first value again" in other.err
    for state in ("resuming at step 1 of 2", "already finished, at step 2"):
        more = fecosplat(*first)
        assert more.code == 0 and f"{tmp_path}/last.pt: {state}\n" in more.err


@pytest.mark.parametrize(("profile", "published"), [("paper", (3.45e6, 37.28e6)), ("paper-large", (3.45e6, 126.11e6))])
def test_sums_are_the_papers_within_one_percent(
    fecosplat: CommandLine, profile: str, published: tuple[float, float]
) -> None:
    rows = json.loads(fecosplat("info", "--parameters", profile, "--json").out)
    counts = {row["module"]: row["parameters"] for row in rows if row["side"] != "sum"}
    sums = [row for row in rows if row["side"] == "sum"]
    for row, expected in zip(sums, published, strict=True):
        assert row["published"] == expected and row["parameters"] == pytest.approx(expected, rel=0.01)
    assert sums[1]["parameters"] == sum(counts.values())
    if profile == "paper":
        expected = {"backbone": 1_049_120, "transformer": 3_150_336, "pretrained": 22_056_192}
        expected |= {"regressor": 6_453_504, "regressor_residual": 98_432}
        lines = fecosplat("info", "--parameters", profile).out.splitlines()
        assert lines[0].endswith("paper's Table 1") and "3.45 M (+" in lines[-2] and "37.28 M (+" in lines[-1]
    else:
        expected = Counter()
        for module, count in PARAMETERS.items():
            expected[module.rstrip(".01")] += count
    assert {name: counts[f"extractor.{name}"] for name in expected} == expected
