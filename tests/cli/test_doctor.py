"""`fecosplat doctor`.

A CUDA device without its renderer: refused before the content of any input is read, where it would be used.
"""

import json
import sys
from importlib.metadata import version

import fecosplat_cli.doctor as doctor
import pytest
import torch
from refusals import assert_refused


def test_versions_extras_and_speed_are_shown(fecosplat) -> None:
    result = fecosplat("doctor", "--json")
    fields = json.loads(result.out)
    assert result.code == 0 and result.err == ""
    assert fields["numpy"] == version("numpy")
    assert fields["rendering_seconds"] > 0
    assert {name.removeprefix("extra ") for name in fields if name.startswith("extra ")} == set(doctor.EXTRAS)


def test_the_receiver_alone_has_no_torch(fecosplat, monkeypatch) -> None:
    found = doctor.installed
    monkeypatch.setattr(doctor, "installed", lambda name: None if name == "torch" else found(name))
    monkeypatch.setitem(sys.modules, "torch", None)  # importing it raises ModuleNotFoundError
    result = fecosplat("doctor", "--json")
    fields = json.loads(result.out)
    assert result.code == 0 and fields["torch"] == "missing"
    assert fields["speed"] == fields["cuda"] == doctor.NOT_MEASURED and fields["rendering_seconds"] is None


def test_a_missing_extra_is_named_with_its_command(fecosplat, monkeypatch) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {"poses": "no-such-distribution"})
    monkeypatch.setattr(doctor, "rendering_seconds", lambda: (0.5, 0.1))
    result = fecosplat("doctor")
    assert "missing: `pip install '.[poses]'` in the project's folder" in result.out


WITHOUT_GSPLAT = (
    "Gaussians on a CUDA device are rendered by gsplat, which is not installed; "
    "run `pip install gsplat`, or use the CPU by --device."
)

PHOTOGRAPHS, GAUSSIANS = "a folder of photographs", "a file of Gaussians"


@pytest.fixture
def cuda_without_gsplat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    monkeypatch.setitem(sys.modules, "gsplat", None)


@pytest.mark.usefixtures("cuda_without_gsplat")
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
def test_what_renders_there_is_refused(fecosplat, photographs, tmp_path, output, monkeypatch, arguments) -> None:
    monkeypatch.chdir(output)
    paths = {PHOTOGRAPHS: photographs, GAUSSIANS: tmp_path / "never-read.ply"}
    paths[GAUSSIANS].write_bytes(b"not read")
    arguments = tuple(str(paths.get(argument, argument)) for argument in arguments)
    assert_refused(fecosplat(*arguments, "--device", "cuda"), output, WITHOUT_GSPLAT)


@pytest.mark.usefixtures("cuda_without_gsplat")
@pytest.mark.parametrize(
    "arguments",
    [
        ("encode", "missing", "-o", "a.fcs", "--stages", "1", "--effort", "fast"),
        ("decode", "missing", "-o", "a.ply"),
        ("render", "missing", "-o", "images"),
    ],
)
def test_what_does_not_goes_on_to_its_input(fecosplat, output, monkeypatch, arguments) -> None:
    monkeypatch.chdir(output)
    assert_refused(fecosplat(*arguments, "--device", "cuda"), output, "missing: ...")
