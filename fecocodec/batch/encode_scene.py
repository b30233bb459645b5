"""Work of a batch that encodes: a scene folder -> the bytes of a `.fcs` file."""

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch

from fecocodec.batch.scene_task import Result
from fecocodec.batch.scenes import listed
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_folder, model_id_of
from fecocodec.codec.encode_folder import encode_folder
from fecocodec.codec.options import EncodingOptions
from fecocodec.model_files import read_bytes
from fecocodec.photographs.image_headers import has_image_name
from fecocodec.photographs.video_frames import is_video
from fecocodec.sender.codec import load_codec
from fecocodec.sender.optimisation_config import config_of_effort

_Stamps = tuple[tuple[int, int], ...]  # (modification time, size) of each weights file


def passed_over(source: Path) -> tuple[str, ...]:
    """Return the names of photographs, videos and archives beside scene folders, which are the only scenes."""
    files = [path for path in listed(source) if path.is_file()] if source.is_dir() else []
    return tuple(path.name for path in files if has_image_name(path) or is_video(path) or path.suffix.lower() == ".zip")


@dataclass(frozen=True)
class EncodeScene:
    """Encode each scene by `encode_folder`. The model is a folder that all processes can read, or the shipped one."""

    encoding: EncodingOptions = EncodingOptions()  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        """Raise InputError for an effort or a sharpness that no scene can be encoded with."""
        config_of_effort(self.encoding.effort, self.encoding.sharpness)

    @property
    def suffix(self) -> str:
        return ".fcs"

    def options(self) -> dict[str, Any]:
        """Return what changes the files, as JSON. The device is not part of it: its files decode alike."""
        given = self.encoding
        names = ["views", "guides", "num_checks", "size", "near", "far", "background"]
        names += ["num_stages", "effort", "metadata"]
        rate = {"lambda": given.lmbda} if given.target is None else _tagged(given.target)
        # Files that were encoded without these stay valid.
        added: dict[str, Any] = {"strict": True} if given.is_strict else {}
        added |= {"masks": given.masks} if given.masks != "leave-out" else {}
        added |= {"sharpness": given.sharpness} if given.sharpness else {}
        return {**rate, **{name: _tagged(getattr(given, name)) for name in names}, **added}

    def weights(self, path: Path) -> dict[str, str]:
        """Return the ids of the weights of receiver and sender. Raises ModelError if a file cannot be read."""
        folder = model_folder(self.encoding.model)
        return _weight_ids(folder, _stamps(folder))

    def run(self, path: Path, name: str) -> Result:
        """Encode the scene in the folder `path`. Raises FecoError."""
        folder = model_folder(self.encoding.model)
        _forget_replaced_networks(folder, _stamps(folder))
        num_threads = torch.get_num_threads()
        report = encode_folder(path, replace(self.encoding, num_threads=num_threads))
        details: dict[str, Any] = {"views": list(report.names), "device": self.encoding.device, "threads": num_threads}
        if report.notes:
            details["notes"] = list(report.notes)
        details |= {"guides": list(report.guides.names), "checks": list(report.checks.names)}
        if report.quality:
            details["context_psnr"] = round(report.quality[-1].psnr, 3)
        if report.checks.quality is not None:
            details["new_view_psnr"] = round(report.checks.quality.psnr, 3)
        return Result(report.data, report.warnings, details)


def _tagged(value: Any) -> Any:
    """Return a value as JSON; a dataclass without its class would lose what it means."""
    kind = type(value)
    return {kind.__name__: vars(value)} if hasattr(kind, "__dataclass_fields__") else value


def _stamps(folder: Path) -> _Stamps:
    """Return what changes when a weights file is replaced, so that long-lived workers load it again."""
    files = (folder / name for name in (RECEIVER_FILE, SENDER_FILE))
    return tuple((file.stat().st_mtime_ns, file.stat().st_size) if file.exists() else (0, 0) for file in files)


@lru_cache(maxsize=2)
def _weight_ids(folder: Path, stamps: _Stamps) -> dict[str, str]:
    sender = read_bytes(folder / SENDER_FILE)
    model_id = model_id_of(read_bytes(folder / RECEIVER_FILE)).hex()
    return {"model_id": model_id, "sender_sha256": hashlib.sha256(sender).hexdigest()}


@lru_cache(maxsize=1)
def _forget_replaced_networks(folder: Path, stamps: _Stamps) -> None:
    load_codec.cache_clear()  # its key has no stamps
