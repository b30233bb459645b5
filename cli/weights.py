"""`--model FOLDER` as the library takes it; without the option the library's own default stands."""

from pathlib import Path
from typing import Any


def of_sender(model: Path | None) -> dict[str, Any]:
    """Arguments of `encode`."""
    if model is None:
        return {}
    folder = model.absolute()
    return {"model": folder.name, "weights": folder.parent}


def of_receiver(model: Path | None) -> dict[str, Any]:
    """Arguments of `decode`."""
    return {} if model is None else {"weights": model}
