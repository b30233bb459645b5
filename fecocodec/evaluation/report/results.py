"""Results of studies in a file of JSON lines: each written when it is known, so that an interrupted report goes on."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fecocodec.errors import InputError, OutputError


class ResultFile:
    """Results by key, of one set of weights; results of other weights in the file are ignored."""

    def __init__(self, path: Path, label: str) -> None:
        """label: changes with the weights. Raises InputError where the file holds something else."""
        self._path, self._label = path, label
        self._known: dict[str, dict[str, Any]] = {}
        try:
            lines = path.read_text().splitlines() if path.exists() else []
            rows = [json.loads(line) for line in lines if line.endswith("}")]  # an interruption may cut the last one
            self._known = {row["key"]: row["values"] for row in rows if row["label"] == label}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not results of this version ({error}); give another work folder.") from error

    def known(self) -> Mapping[str, dict[str, Any]]:
        """All results in the order of measurement."""
        return self._known

    def add(self, key: str, values: dict[str, Any]) -> None:
        """Append; raises OutputError where that fails."""
        self._known[key] = values
        try:
            with self._path.open("a") as file:
                file.write(
                    "\n" * self._is_cut() + json.dumps({"key": key, "label": self._label, "values": values}) + "\n"
                )
        except OSError as error:
            raise OutputError(
                f"{self._path}: writing failed ({error.strerror}); check free space and permissions."
            ) from error

    def _is_cut(self) -> bool:
        """Whether the file's last line has no end."""
        if not self._path.exists():
            return False
        data = self._path.read_bytes()
        return bool(data) and not data.endswith(b"\n")
