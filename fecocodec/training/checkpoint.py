"""Checkpoints of a training run, with everything needed to resume exactly."""

import os
from pathlib import Path
from typing import Any

import torch

from fecocodec.errors import ModelError, OutputError


def save_checkpoint(path: Path, contents: dict[str, Any]) -> None:
    """Write to a temporary name and rename, so that an interruption leaves the old or the new file, never a part.

    Raises OutputError if writing fails (disk full, no permission); the old file is kept.
    """
    partial = path.with_suffix(".partial")
    try:
        torch.save(contents, partial)
        os.replace(partial, path)
    except (OSError, RuntimeError) as error:  # torch's writer raises RuntimeError for a full disk
        partial.unlink(missing_ok=True)
        reason = str(error).splitlines()[0]
        raise OutputError(
            f"{path}: the checkpoint cannot be written ({reason}); make room or train in another folder."
        ) from error


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a file of `save_checkpoint`. Raises ModelError for anything else."""
    if path.exists() and not path.is_file():
        raise ModelError(f"{path}: not a training checkpoint (no regular file); delete it or name another.")
    try:
        contents = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can fail in many ways
        kind = type(error).__name__
        raise ModelError(f"{path}: not a training checkpoint ({kind}); delete it or name another.") from error
    if not isinstance(contents, dict):
        raise ModelError(f"{path}: not a training checkpoint (a {type(contents).__name__}); delete it or name another.")
    return contents
