"""`fecosplat encode --target-kib` and `--target-psnr`: the file keeps the target, and `info` shows its lambda."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import CommandLine


@pytest.mark.usefixtures("networks")
def test_a_target_is_kept_and_its_lambda_is_shown(fecosplat: CommandLine, photographs: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.fcs"
    options = ("--views", "0,1", "--effort", "fast", "--json")
    largest = json.loads(fecosplat("encode", photographs, "-o", file, *options, "--target-kib", 1000).out)["bytes"]
    target = 0.7 * largest / 1024
    result = fecosplat("encode", photographs, "-o", file, *options, "--target-kib", target, "--overwrite")
    assert result.code == 0 and file.stat().st_size <= 1024 * target
    described = json.loads(fecosplat("info", file, "--json").out)
    assert 1e-5 < described["lambda"] <= 1e-2


@pytest.mark.usefixtures("networks")
def test_targets_out_of_reach_are_refused(fecosplat: CommandLine, photographs: Path, tmp_path: Path) -> None:
    arguments = ("encode", photographs, "-o", tmp_path / "scene.fcs", "--views", "0,1", "--effort", "fast")
    small = fecosplat(*arguments, "--target-kib", "0.1")
    assert small.code == 1 and "a file of 0.1 KiB cannot be made, the smallest has" in small.err
    good = fecosplat(*arguments, "--target-psnr", "80")
    assert good.code == 1 and "a PSNR of 80 dB cannot be reached, the best is" in good.err
    assert not (tmp_path / "scene.fcs").exists()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--target-kib", "8", "--target-psnr", "25"), "exclude each other"),
        (("--effort", "fast", "--sharpness", "1"), "--sharpness needs the steps that --effort fast leaves out"),
        (("--effort", "fast", "--sharpness", "-0.5"), "--sharpness needs the steps that --effort fast leaves out"),
        (("--sharpness", "1.5"), "1.5 is not in the range -1.0<=x<=1.0"),
        (("--target-kib", "8", "--stages", "1"), "has no rate control"),
        (("--target-kib", "8", "--lambda", "1e-3"), "leave out --lambda"),
    ],
)
def test_options_that_contradict_each_other(
    fecosplat: CommandLine, photographs: Path, tmp_path: Path, options: tuple[str, ...], sentence: str
) -> None:
    result = fecosplat("encode", photographs, "-o", tmp_path / "scene.fcs", *options)
    assert result.code == 2 and sentence in result.err


@pytest.mark.usefixtures("networks")
def test_views_that_reconstruct_badly_get_a_warning(fecosplat: CommandLine, photographs: Path, tmp_path: Path) -> None:
    single = fecosplat(
        "encode", photographs, "-o", tmp_path / "one.fcs", "--views", "0", "--guides", "none", "--effort", "fast"
    )
    assert single.code == 0 and "warning: one view has no parallax" in single.err


@pytest.mark.usefixtures("networks")
def test_a_single_stage_is_optimised_too(fecosplat: CommandLine, photographs: Path, tmp_path: Path) -> None:
    files = [tmp_path / f"{effort}.fcs" for effort in ("fast", "default")]
    for effort, file in zip(("fast", "default"), files, strict=True):
        assert fecosplat("encode", photographs, "-o", file, "--stages", "1", "--effort", effort).code == 0
    assert files[0].read_bytes() != files[1].read_bytes()
