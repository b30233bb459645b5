"""Seconds of each step of a call, from its progress messages."""

from time import perf_counter


class StepClock:
    """A progress callback that sums the seconds between messages, each under the message that began them."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._task, self._since = "start", perf_counter()

    def __call__(self, task: str, _fraction: float) -> None:
        self.close()
        self._task = task

    def close(self) -> None:
        """End the last step."""
        now = perf_counter()
        self.seconds[self._task] = self.seconds.get(self._task, 0.0) + now - self._since
        self._since = now
