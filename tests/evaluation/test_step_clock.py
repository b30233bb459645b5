"""The seconds between messages of progress belong to the message that began them."""

import pytest

from fecocodec.evaluation import machine
from fecocodec.evaluation.machine import StepClock


def test_seconds_of_a_step_that_comes_again_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([10.0, 11.0, 13.0, 16.0, 20.0])
    monkeypatch.setattr(machine, "perf_counter", lambda: next(times))
    clock = StepClock()
    for task in ("matching", "coding", "matching"):
        clock(task, 0.0)
    clock.close()
    assert clock.seconds == {"start": 1.0, "matching": 2.0 + 4.0, "coding": 3.0}
