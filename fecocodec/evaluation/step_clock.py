"""Measure the time of each processing step of a call from its progress messages."""

from time import perf_counter


class StepClock:
    """Progress callback that measures the seconds of each step. seconds: by name of the step, filled on the next call.

    A step lasts from its message to the next one.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._task, self._since = "start", perf_counter()

    def __call__(self, task: str, _fraction: float) -> None:
        self.close()
        self._task = task

    def close(self) -> None:
        """Record the end of the current step; call this after the measured call returns."""
        now = perf_counter()
        self.seconds[self._task] = self.seconds.get(self._task, 0.0) + now - self._since
        self._since = now
