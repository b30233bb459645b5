"""A run is resumed with what decided it, and refused with anything else; it may be made longer."""

from dataclasses import replace
from pathlib import Path

import pytest

from fecocodec.errors import InputError
from fecocodec.training.configurations import Configuration, RunSettings, configuration_named
from fecocodec.training.same_run import deciding_values, fingerprint, require_same_run

COMPACT, PAPER = configuration_named("compact"), configuration_named("paper-re10k")
CHECKPOINT = Path("run/last.pt")


def settings(configuration: Configuration, /, **origin: str) -> RunSettings:
    return RunSettings(Path("run"), configuration, None, origin=origin)


def scheduled(**changes: object) -> Configuration:
    return replace(COMPACT, schedule=replace(COMPACT.schedule, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("begun", "resumed", "named"),
    [
        (settings(COMPACT), settings(scheduled(learning_rate=1e-3)), "`learning_rate`"),
        (settings(COMPACT), settings(replace(COMPACT, lambda_range=(1e-4, 1e-2))), "`lambda_range`"),
        (settings(PAPER), settings(replace(PAPER, distortion=PAPER.with_perceptual("none"))), "`perceptual`"),
        (settings(COMPACT, seed="1", start="a"), settings(COMPACT, seed="2", start="b"), "`seed`, `start`"),
        (settings(scheduled(bypass_until=5)), settings(COMPACT), "`bypass_until`"),
        (settings(COMPACT, configuration="a"), settings(PAPER, configuration="b"), "`configuration`"),
    ],
)
def test_a_difference_is_named_by_its_argument(begun: RunSettings, resumed: RunSettings, named: str) -> None:
    saved = deciding_values(begun)
    require_same_run(saved, begun, CHECKPOINT)
    require_same_run({}, resumed, CHECKPOINT)  # of an older checkpoint
    with pytest.raises(InputError, match=rf"^run/last\.pt: this run began with another {named}; give the first"):
        require_same_run(saved, resumed, CHECKPOINT)


def test_more_steps_are_the_same_run() -> None:
    require_same_run(deciding_values(settings(COMPACT)), settings(scheduled(num_steps=10**6)), CHECKPOINT)


def test_inputs_are_the_same_in_another_place(tmp_path: Path) -> None:
    for name in ("here/a", "there/a", "others/b"):
        (tmp_path / name).mkdir(parents=True)
    here, there, others = (fingerprint(tmp_path / name) for name in ("here", "there", "others"))
    assert here == there and len({here, others, fingerprint(None)}) == 3
    for data in (b"one", b"two"):
        (tmp_path / "here" / "receiver.safetensors").write_bytes(data)
        assert fingerprint(tmp_path / "here") != here
        here = fingerprint(tmp_path / "here")
