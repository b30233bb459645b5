"""A CUDA device without its renderer: refused before the content of any input is read, where it would be used."""

import sys
from pathlib import Path

import pytest
import torch
from refusals import assert_refused

WITHOUT_GSPLAT = (
    "Gaussians on a CUDA device are rendered by gsplat, which is not installed; "
    "run `pip install gsplat`, or use the CPU by --device."
)

PHOTOGRAPHS, GAUSSIANS = "a folder of photographs", "a file of Gaussians"


@pytest.fixture(autouse=True)
def cuda_without_gsplat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    monkeypatch.setitem(sys.modules, "gsplat", None)


@pytest.mark.parametrize(
    "arguments",
    [
        ("encode", PHOTOGRAPHS, "-o", "a.fcs"),
        ("encode", PHOTOGRAPHS, "-o", "a.fcs", "--target-kib", "8"),
        ("encode", PHOTOGRAPHS, "-o", "a.fcs", "--stages", "1"),
        ("render", GAUSSIANS, "-o", "images", "--cameras", PHOTOGRAPHS),
        ("train", "run"),
    ],
)
def test_what_renders_there_is_refused(
    fecosplat,
    photographs: Path,
    tmp_path: Path,
    output: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
) -> None:
    monkeypatch.chdir(output)
    paths = {PHOTOGRAPHS: photographs, GAUSSIANS: tmp_path / "never-read.ply"}
    paths[GAUSSIANS].write_bytes(b"not read")
    arguments = tuple(str(paths.get(argument, argument)) for argument in arguments)
    assert_refused(fecosplat(*arguments, "--device", "cuda"), output, WITHOUT_GSPLAT)


@pytest.mark.parametrize(
    "arguments",
    [
        ("encode", "missing", "-o", "a.fcs", "--stages", "1", "--effort", "fast"),
        ("decode", "missing", "-o", "a.ply"),
        ("render", "missing", "-o", "images"),
    ],
)
def test_what_does_not_goes_on_to_its_input(
    fecosplat, output: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(output)
    assert_refused(fecosplat(*arguments, "--device", "cuda"), output, "missing: ...")
