"""A CUDA device without the renderer for it: refused before any input is read, where the command would render there."""

import sys
from pathlib import Path

import pytest
import torch
from refusals import assert_refused

WITHOUT_GSPLAT = (
    "Gaussians on a CUDA device are rendered by gsplat, which is not installed; "
    "run `pip install gsplat`, or stay on the CPU (--device cpu)."
)


@pytest.fixture(autouse=True)
def cuda_without_gsplat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    monkeypatch.setitem(sys.modules, "gsplat", None)


@pytest.mark.parametrize(
    "arguments",
    [
        ("encode", "missing", "-o", "a.fcs"),
        ("encode", "missing", "-o", "a.fcs", "--target-kib", "8"),
        ("encode", "missing", "-o", "a.fcs", "--stages", "1"),
        ("render", "missing.ply", "-o", "images", "--cameras", "missing"),
        ("train", "run"),
    ],
)
def test_what_renders_there_is_refused(
    fecosplat, output: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(output)
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
