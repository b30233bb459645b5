"""`--config-file`: default values of options from a TOML file, and what is refused.

`fecosplat encode --target-kib` and `--target-psnr`: the file keeps the target, and `info` shows its lambda.
"""

import json
from pathlib import Path

import pytest

from fecocodec.container import inspect
from tests.cli.conftest import CommandLine

SMALL = ("--views", "0,1", "--guides", "none", "--size", "64x64")


def test_values_of_the_table_are_defaults(fecosplat, networks, photographs: Path, tmp_path: Path) -> None:
    config, output = tmp_path / "options.toml", tmp_path / "wall.fcs"
    config.write_text(
        f'[encode]\noutput = "{output}"\nlambda = 1e-2\neffort = "fast"\nviews = "0,1"\nsize = "64x72"\nstages = 1\n'
        "[decode]\nmerge = true\n"
    )
    result = fecosplat("encode", photographs, "--config-file", config, "--lambda", "1e-3")
    assert (result.code, result.out) == (0, "")
    header = inspect(output.read_bytes()).header
    assert (header.num_views, header.width, header.height, header.num_stages) == (2, 64, 72, 1)
    assert header.lambda_of_stage(1) == pytest.approx(1e-3, rel=0.01)  # the command line overrides the file


def test_tables_of_batch_commands_are_nested(fecosplat, networks, photographs: Path, tmp_path: Path) -> None:
    config, root = tmp_path / "options.toml", tmp_path / "scenes"
    root.mkdir()
    (root / "wall").symlink_to(photographs)
    config.write_text('[batch.encode]\nshard = "1/1"\neffort = "fast"\nviews = "0,1"\nquiet = true\n')
    result = fecosplat("batch", "encode", root, "-o", tmp_path / "coded", "--config-file", config)
    assert (result.code, result.out, result.err) == (0, "", "")
    assert (tmp_path / "coded" / "wall.fcs").exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "[encode]\nlamda = 1\n",
            "table [encode]: there is no option 'lamda'; the command lists its options with --help.",
        ),
        ("[encoed]\n", "there is no command 'encoed'; give each table the name of a command."),
        ("encode = 3\n", "'encode' is not a table; write options below [encode]."),
        (
            "[encode]\nsize = []\n",
            "table [encode]: the value of 'size' is no text, number or boolean; correct the file.",
        ),
        ("[encode\n", "broken TOML ("),
    ],
)
def test_a_wrong_file_is_one_sentence(fecosplat, tmp_path: Path, text: str, sentence: str) -> None:
    config = tmp_path / "options.toml"
    config.write_text(text)
    result = fecosplat("encode", tmp_path, "-o", tmp_path / "a.fcs", "--config-file", config)
    assert (result.code, result.out, result.err.count("\n")) == (1, "", 1)
    assert result.err.startswith(f"fecosplat: {config}") and sentence in result.err
    assert list(tmp_path.iterdir()) == [config]


def test_a_missing_file_is_one_sentence(fecosplat, tmp_path: Path) -> None:
    result = fecosplat("info", "--config-file", tmp_path / "none.toml", "a.fcs")
    assert result.code == 1
    assert result.err.startswith(f"fecosplat: {tmp_path / 'none.toml'}: cannot be read (No such file or directory); ")


def test_a_wrong_value_names_the_option_and_the_file_it_is_from(fecosplat, tmp_path: Path) -> None:
    config = tmp_path / "options.toml"
    config.write_text('[encode]\neffort = "most"\n')
    result = fecosplat("encode", tmp_path, "-o", tmp_path / "a.fcs", "--config-file", config)
    assert result.code == 2
    assert "Invalid value for '--effort': 'most' is not one of" in result.err
    assert f"; the value is in {config}." in result.err
    config.write_text('[encode]\neffort = "fast"\n')
    result = fecosplat("encode", tmp_path, "-o", tmp_path / "a.fcs", "--effort", "most", "--config-file", config)
    assert result.code == 2
    assert "Invalid value for '--effort'" in result.err and str(config) not in result.err


@pytest.mark.usefixtures("networks")
def test_a_target_is_kept_and_its_lambda_is_shown(fecosplat: CommandLine, photographs: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.fcs"
    options = (*SMALL, "--effort", "fast", "--json")
    largest = json.loads(fecosplat("encode", photographs, "-o", file, *options, "--target-kib", 1000).out)["bytes"]
    target = 0.7 * largest / 1024
    result = fecosplat("encode", photographs, "-o", file, *options, "--target-kib", target, "--overwrite")
    assert result.code == 0 and file.stat().st_size <= 1024 * target
    described = json.loads(fecosplat("info", file, "--json").out)
    assert 1e-5 < described["lambda"] <= 1e-2


@pytest.mark.usefixtures("networks")
def test_a_target_out_of_reach_is_refused(fecosplat: CommandLine, photographs: Path, output: Path) -> None:
    arguments = ("encode", photographs, "-o", output / "scene.fcs", *SMALL, "--effort", "fast")
    result = fecosplat(*arguments, "--target-psnr", "80")
    assert result.code == 1 and "a PSNR of 80 dB cannot be reached, the best is" in result.err
    assert list(output.iterdir()) == []
