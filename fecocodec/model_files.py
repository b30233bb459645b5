"""Folders and files of models: names, model id, and the search for the weights with a model id. No torch."""

import errno
import hashlib
import json
import os
import stat
from dataclasses import dataclass
from pathlib import Path

from fecocodec.config import COMPACT, METHODS, Method
from fecocodec.errors import ModelError
from fecocodec.grid import PER_CELL

SHIPPED = Path(__file__).parent / "weights"
DEFAULT_MODEL = "compact-6"
RECEIVER_FILE, SENDER_FILE = "receiver.safetensors", "sender.safetensors"
GRAPHS_FOLDER = "graphs"  # in a model's folder
NETWORK_GRAPHS = (
    *("hyper", "features_1", "features_2", "pass_1", "pass_2", "step_1", "step_2", "step_3"),
    *("update", "points", "attend", "attributes"),
)
RULE_GRAPHS = ("confirm", "free_space", "duplicates", "slope", "harmonics", "background", "hide", "occluded", "behind")
MODEL_ID_BYTES = 8
MAX_WEIGHTS_BYTES = 1 << 30  # the paper's networks take 75 MB in fp16


def model_id_of(data: bytes) -> bytes:
    """Return the model id of the bytes of a receiver's weights file."""
    return hashlib.sha256(data).digest()[:MODEL_ID_BYTES]


@dataclass(frozen=True)
class ReceiverKind:
    """What a receiver without torch must know of a model. gaussians_per_side: of a cell of the 1/4 grid."""

    method: Method
    gaussians_per_side: int

    @property
    def graph_names(self) -> tuple[str, ...]:
        """Names of all graphs of the model."""
        return NETWORK_GRAPHS + (RULE_GRAPHS if self.method.has_rules else ())


def receiver_kind(data: bytes) -> ReceiverKind:
    """Return the kind of the receiver in the bytes of a weights file, from its metadata (see `serialise_weights`).

    Raises ModelError if they are not those of a weights file, or of a method that this version does not know.
    """
    try:
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
        fields = json.loads(header["__metadata__"]["config"]).get("receiver", {})
        return ReceiverKind(METHODS[fields.get("method", COMPACT)], fields.get("gaussians_per_side", PER_CELL))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelError("the weights of the receiver are of another version; install that version.") from error


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a weights file. Raises ModelError if it cannot be read or is no regular file."""
    try:
        _require_weights_file(path)
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: not a valid file name
        reason = getattr(error, "strerror", None) or str(error)
        raise ModelError(
            f"{path}: the weights cannot be read ({reason}); name the folder of a model, or reinstall the package."
        ) from error


def _require_weights_file(path: Path) -> None:
    """Raise OSError for a folder, or for a pipe or device, from which reading may never end; ModelError if too long."""
    found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "a pipe or a device")
    if found.st_size > MAX_WEIGHTS_BYTES:
        raise ModelError(
            f"{path}: the weights have {found.st_size} bytes, but at most {MAX_WEIGHTS_BYTES} are read; name the "
            "folder of a model, or reinstall the package."
        )


def model_folder(model: Path | str | None) -> Path:
    """Return the absolute path of a model's folder; None selects the default shipped model."""
    return SHIPPED / DEFAULT_MODEL if model is None else Path(model).absolute()


def find_receiver(model_id: bytes, model: Path | None = None) -> Path:
    """Return the path of the receiver's weights with this model id, in the folder `model` or (None) among the shipped.

    Raises ModelError if the folder is missing or has no receiver with this id.
    """
    folder = SHIPPED if model is None else model
    if not os.path.isdir(folder):  # `Path.is_dir` raises for a name that is too long
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


def is_shipped(model_id: bytes) -> bool:
    """Return whether a receiver with this model id ships; thresholds of warnings were measured with those."""
    return any(model_id_of(read_bytes(path)) == model_id for path in SHIPPED.glob(f"*/{RECEIVER_FILE}"))


def has_graphs(folder: Path, model_id: bytes) -> bool:
    """Return whether a model's folder has all graphs of the receiver with this model id.

    An interrupted export leaves some of them missing, or of earlier weights: each graph holds the id of its own.
    """
    names = receiver_kind(read_bytes(folder / RECEIVER_FILE)).graph_names
    paths = [folder / GRAPHS_FOLDER / f"{name}.onnx" for name in names]
    return all(path.is_file() and model_id.hex().encode("ascii") in path.read_bytes() for path in paths)
