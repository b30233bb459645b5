"""`fecosplat doctor`."""

import json
import sys
from importlib.metadata import version

import fecosplat_cli.doctor as doctor


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
