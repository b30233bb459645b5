"""Folders and files of models: names, model id, and the search for the weights with a model id. No torch."""

import hashlib
from pathlib import Path

from fecocodec.errors import ModelError

SHIPPED = Path(__file__).parent / "weights"
DEFAULT_MODEL = "compact-2"
RECEIVER_FILE, SENDER_FILE = "receiver.safetensors", "sender.safetensors"
GRAPHS_FOLDER = "graphs"  # in a model's folder
MODEL_ID_BYTES = 8


def model_id_of(data: bytes) -> bytes:
    """Return the model id of the bytes of a receiver's weights file."""
    return hashlib.sha256(data).digest()[:MODEL_ID_BYTES]


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a weights file. Raises ModelError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ModelError(
            f"{path}: the weights cannot be read ({error.strerror}); "
            "name the folder of a model, or reinstall the package."
        ) from error


def model_folder(model: Path | str | None) -> Path:
    """Return the absolute path of a model's folder; None selects the default shipped model."""
    return SHIPPED / DEFAULT_MODEL if model is None else Path(model).absolute()


def find_receiver(model_id: bytes, model: Path | None = None) -> Path:
    """Return the path of the receiver's weights with this model id, in the folder `model` or (None) among the shipped.

    Raises ModelError if the folder is missing or has no receiver with this id.
    """
    folder = SHIPPED if model is None else model
    if not folder.is_dir():
        raise ModelError(f"{folder}: there is no such folder; name the folder of a model.")
    candidates = sorted(folder.glob(f"*/{RECEIVER_FILE}" if model is None else RECEIVER_FILE))
    for path in candidates:
        if model_id_of(read_bytes(path)) == model_id:
            return path
    known = ", ".join(path.parent.absolute().name for path in candidates) or "none"
    raise ModelError(
        f"the stream needs the receiver weights with model id {model_id.hex()}, but {folder} has {known}; "
        "install the version of the package that made the file, or name the folder of its model."
    )
