"""`fecosplat doctor`."""

import json
from importlib.metadata import version

import fecosplat_cli.doctor as doctor


def test_versions_extras_and_speed_are_shown(fecosplat) -> None:
    result = fecosplat("doctor", "--json")
    fields = json.loads(result.out)
    assert result.code == 0 and result.err == ""
    assert fields["numpy"] == version("numpy")
    assert fields["rendering_seconds"] > 0
    assert {name.removeprefix("extra ") for name in fields if name.startswith("extra ")} == set(doctor.EXTRAS)


def test_a_missing_extra_is_named_with_its_command(fecosplat, monkeypatch) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {"poses": "no-such-distribution"})
    monkeypatch.setattr(doctor, "rendering_seconds", lambda: (0.5, 0.1))
    result = fecosplat("doctor")
    assert "missing: pip install 'fecosplat[poses]'" in result.out
