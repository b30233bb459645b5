"""Works without networks, which worker processes import."""

import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fecocodec.batch.scene_task import Result
from fecocodec.errors import InputError


@dataclass(frozen=True)
class Reverse:
    """Write the bytes of `text` in reverse; `bad` and `bug` raise, and `kill` ends the process, once or always."""

    option: int = 1
    version: str = "first"

    @property
    def suffix(self) -> str:
        return ".rev"

    def options(self) -> dict[str, Any]:
        return {"option": self.option, "size": (1, 2)}

    def weights(self, path: Path) -> dict[str, str]:
        return {"model_id": self.version}

    def run(self, path: Path, name: str) -> Result:
        text = (path / "text").read_text()
        if text == "bad":
            raise InputError(f"{path}: the text is bad; write another.")
        if text == "bug":
            raise ValueError("a defect")
        if text == "kill once":
            kill_once(path.parent / f"{name}.killed")
        if text == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        with (path.parent / f"{name}.runs").open("a") as log:
            log.write(".")
        return Result(text[::-1].encode(), (f"warned by {name}",) if text == "warn" else (), {"length": len(text)})


def kill_once(marker: Path) -> None:
    """Kill this process, unless the file `marker` says that this was done before."""
    if not marker.exists():
        marker.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
