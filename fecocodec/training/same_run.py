"""What decides a training run: its checkpoint holds it, so that a run is not resumed with other options unnoticed."""

from collections.abc import Mapping
from dataclasses import asdict
from hashlib import sha256
from os import fsencode
from pathlib import Path

from fecocodec.errors import InputError, some_of
from fecocodec.model_files import RECEIVER_FILE, SENDER_FILE
from fecocodec.training.configurations import RunSettings

NUM_STEPS = "schedule.num_steps"  # a run may be made longer
CONFIGURATION = "configuration"  # its name, on which all other fields depend


def deciding_values(settings: RunSettings) -> dict[str, object]:
    """Return what decides a run, as a checkpoint can hold it: numbers, strings and tuples of them, by name."""
    configuration = settings.configuration
    found = _flat("", asdict(configuration)) | {"distortion": type(configuration.distortion).__name__}
    return {name: value for name, value in found.items() if name != NUM_STEPS} | dict(settings.origin)


def require_same_run(saved: Mapping[str, object], settings: RunSettings, checkpoint: Path) -> None:
    """Raise InputError if a checkpoint is of a run that something else decided.

    saved: `deciding_values` of that run; only names in both are compared, because other versions have other fields.
    """
    own = deciding_values(settings)
    changed = [name.rpartition(".")[2] for name in own if name in saved and own[name] != saved[name]]
    if not changed:
        return
    names = dict.fromkeys([CONFIGURATION] if CONFIGURATION in changed else changed)
    options = tuple(f"`{name}`" for name in names)
    raise InputError(
        f"{checkpoint}: this run began with another {some_of(options, 8)}; give the first value again, or train in "
        "another folder."
    )


def fingerprint(*paths: Path | None) -> str:
    """Return a digest of files and folders, equal in another place: weights of models, else names and sizes."""
    digest = sha256()
    for path in filter(None, paths):
        weights = [path / name for name in (RECEIVER_FILE, SENDER_FILE) if (path / name).is_file()]
        for file in weights:
            digest.update(file.read_bytes())
        for entry in [] if weights else sorted(path.iterdir()) if path.is_dir() else [path]:
            digest.update(b"%s %d\n" % (fsencode(entry.name), entry.stat().st_size if entry.is_file() else 0))
    return digest.hexdigest()


def _flat(prefix: str, fields: Mapping[str, object]) -> dict[str, object]:
    """Return nested fields by their names, joined with points."""
    found: dict[str, object] = {}
    for name, value in fields.items():
        found |= _flat(f"{prefix}{name}.", value) if isinstance(value, Mapping) else {prefix + name: value}
    return found
