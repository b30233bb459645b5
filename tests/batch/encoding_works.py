"""Encoding in worker processes, one of which is killed."""

from dataclasses import dataclass
from pathlib import Path

from fecocodec.batch.encode_scene import EncodeScene
from fecocodec.batch.scene_task import Result
from tests.batch.works import kill_once


@dataclass(frozen=True)
class EncodeAndDie(EncodeScene):
    """Encode; the process is killed while it works on the scene `dying`, the first time."""

    dying: str = ""

    def run(self, path: Path, name: str) -> Result:
        result = super().run(path, name)
        if name == self.dying:
            kill_once(path.parent.parent / "killed")
        return result
