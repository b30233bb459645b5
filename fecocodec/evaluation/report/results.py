"""Results of studies in a JSON Lines file, each written immediately, so that an interrupted report can be resumed."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fecocodec.errors import InputError, OutputError


class ResultFile:
    """Results by key, for one set of weights. Results of other weights in the file are ignored."""

    def __init__(self, path: Path, label: str) -> None:
        """label: identifies the weights. Raises InputError if the file does not contain results."""
        self._path, self._label = path, label
        self._known: dict[str, dict[str, Any]] = {}
        try:
            lines = path.read_text().splitlines() if path.exists() else []
            rows = [json.loads(line) for line in lines if line.endswith("}")]  # the last line may be incomplete
            self._known = {row["key"]: row["values"] for row in rows if row["label"] == label}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not results of this version ({error}); give another work folder.") from error

    def known(self) -> Mapping[str, dict[str, Any]]:
        """Return all results in the order of measurement."""
        return self._known

    def add(self, key: str, values: dict[str, Any]) -> None:
        """Store a result and append it to the file. Raises OutputError if writing fails."""
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
        """Return whether the last line of the file is incomplete."""
        if not self._path.exists():
            return False
        data = self._path.read_bytes()
        return bool(data) and not data.endswith(b"\n")
