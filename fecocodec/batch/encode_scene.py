"""Work of a batch that encodes: a scene folder -> the bytes of a `.fcs` file."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch

from fecocodec.batch.scene_task import Result
from fecocodec.camera_files.find import has_cameras, unread_cameras_notes
from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.captures.scene_folder import read_pixels
from fecocodec.captures.view_selection import Selection, may_leave_out
from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_folder, model_id_of
from fecocodec.container import quantise_lambda, with_metadata
from fecocodec.errors import InputError, strict_error
from fecocodec.geometry.views import Views
from fecocodec.model_files import read_bytes
from fecocodec.photographs.images import Background
from fecocodec.poses.posed_folder import posed_folder
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.decoded_quality import decoded_quality, quality_warnings
from fecocodec.sender.encode import OnWarning, check_views, encode_with
from fecocodec.sender.harmful_views import left_out_note, without_harmful_views_with
from fecocodec.sender.input_warnings import check_input
from fecocodec.sender.optimisation_config import config_of_effort
from fecocodec.sender.rate_control import Target, encode_to_target_with

_Stamps = tuple[tuple[int, int], ...]  # (modification time, size) of each weights file


@dataclass(frozen=True)
class EncodeScene:
    """Encode each scene as `encode` does; cameras are estimated for folders without cameras.

    views: as for `read_views`, or `Spread`, `Auto` or `All`. target: None encodes at `lmbda`. metadata: stored in every
    file. model: a folder that all processes can read; None for the shipped model. is_measured: decode each file, and
    record the PSNR of the context views. is_strict: measure too, and fail at the first warning. Other fields are the
    arguments of `read_views` and `encode`.
    """

    lmbda: float = 1e-3
    target: Target | None = None
    views: Selection | None = None
    size: tuple[int, int] | None = None
    near: float | None = None
    far: float | None = None
    background: Background | None = None
    num_stages: int = 2
    effort: str = "default"
    sharpness: float = 0.0
    metadata: dict[str, str] = field(default_factory=dict)
    device: str = "cpu"
    model: str | None = None
    is_measured: bool = False
    is_strict: bool = False

    def __post_init__(self) -> None:
        """Raise InputError for a lambda, an effort or a sharpness that no scene can be encoded with."""
        quantise_lambda(self.lmbda)
        config_of_effort(self.effort, self.sharpness)

    @property
    def suffix(self) -> str:
        return ".fcs"

    def options(self) -> dict[str, Any]:
        """Return what changes the files, as JSON. The device is not part of it: its files decode alike."""
        names = ("views", "size", "near", "far", "background", "num_stages", "effort", "metadata")
        rate = {"lambda": self.lmbda} if self.target is None else _tagged(self.target)
        # Files that were encoded without these stay valid.
        added: dict[str, Any] = {"strict": True} if self.is_strict else {}
        added |= {"sharpness": self.sharpness} if self.sharpness else {}
        return {**rate, **{name: _tagged(getattr(self, name)) for name in names}, **added}

    def weights(self, path: Path) -> dict[str, str]:
        """Return the ids of the weights of receiver and sender. Raises ModelError if a file cannot be read."""
        folder = model_folder(self.model)
        return _weight_ids(folder, _stamps(folder))

    def run(self, path: Path, name: str) -> Result:
        """Encode the scene in the folder `path`. Raises FecoError."""
        folder = model_folder(self.model)
        codec = _codec(folder, self.device, _stamps(folder))
        warnings: list[str] = []
        left_out: list[str] = []

        def report(warning: str) -> None:
            if self.is_strict:
                raise strict_error(str(path), warning)
            warnings.append(warning)

        with _with_cameras(path) as (scene, notes, doubts):
            chosen = choose_photographs(scene, views=self.views, size=self.size)
            views = read_pixels(chosen, near=self.near, far=self.far, background=self.background)
            notes = (*notes, *chosen.remarks)
            try:
                check_views(views, self.num_stages)
                if may_leave_out(self.views):
                    lambda_q = quantise_lambda(self.lmbda)
                    views = without_harmful_views_with(codec, views, lambda_q, left_out.extend)
                for warning in (*doubts, *views.notes, *check_input(views, self.effort)):
                    report(warning)
                data = self._encoded(codec, views, report)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
        if self.metadata:
            data = with_metadata(data, self.metadata)
        details: dict[str, Any] = {"views": list(views.names), "device": self.device}
        details["threads"] = torch.get_num_threads()
        if left_out:
            notes = (*notes, left_out_note(left_out))
        if notes:
            details["notes"] = list(notes)
        if self.is_measured or self.is_strict:
            quality = decoded_quality(codec.receiver, data, views)
            details["context_psnr"] = round(quality.psnr, 3)
            for warning in quality_warnings(quality, views.names):
                report(warning)
        return Result(data, tuple(warnings), details)

    def _encoded(self, codec: Codec, views: Views, on_warning: OnWarning) -> bytes:
        config = config_of_effort(self.effort, self.sharpness)
        if self.target is not None:
            return encode_to_target_with(codec, views, self.target, config, on_warning=on_warning)
        lambda_q = quantise_lambda(self.lmbda)
        return encode_with(codec, views, lambda_q, self.num_stages, config, on_warning=on_warning)


@contextmanager
def _with_cameras(path: Path) -> Iterator[tuple[Path, tuple[str, ...], tuple[str, ...]]]:
    """Yield a scene folder with cameras, estimated if there are none, and notes and warnings about the estimate."""
    if has_cameras(path):
        yield path, (), ()
        return
    with posed_folder(path, torch.get_num_threads(), str(path)) as posed:
        yield posed.path, (*unread_cameras_notes(path), *posed.notes), posed.warnings


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
def _codec(folder: Path, device: str, stamps: _Stamps) -> Codec:
    load_codec.cache_clear()  # its key has no stamps
    return load_codec(folder, device)
