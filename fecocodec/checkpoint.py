"""Weights files in safetensors format."""

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from fecocodec.config import is_in_range, optional_fields
from fecocodec.errors import ModelError
from fecocodec.model_files import DEFAULT_MODEL as DEFAULT_MODEL
from fecocodec.model_files import RECEIVER_FILE as RECEIVER_FILE
from fecocodec.model_files import SENDER_FILE as SENDER_FILE
from fecocodec.model_files import SHIPPED as SHIPPED
from fecocodec.model_files import find_receiver as find_receiver
from fecocodec.model_files import model_folder as model_folder
from fecocodec.model_files import model_id_of as model_id_of
from fecocodec.model_files import read_bytes

Config = TypeVar("Config")


@dataclass(frozen=True)
class Weights:
    """Content of a weights file.

    config: the key "receiver" or "sender" with the fields of that configuration, as parsed from JSON. model_id: first 8
    bytes of the SHA-256 of the file.
    """

    tensors: dict[str, Tensor]
    config: dict[str, Any]
    model_id: bytes


def serialise_weights(tensors: dict[str, Tensor], config: dict[str, Any]) -> bytes:
    """Return the bytes of a weights file, floats as fp16. Raises ModelError for NaN, or floats out of range of fp16."""
    stored = {name: _stored(name, value).contiguous() for name, value in tensors.items()}
    return save(stored, metadata={"config": json.dumps(config, sort_keys=True)})


def _stored(name: str, value: Tensor) -> Tensor:
    if not value.is_floating_point():
        return value
    halves = value.half()
    if not bool(halves.isfinite().all()):
        raise ModelError(
            f"tensor '{name}': it holds NaN or values beyond the {torch.finfo(torch.half).max:.0f} of fp16; "
            "export an earlier checkpoint."
        )
    return halves


def read_weights(path: Path) -> Weights:
    """Read a weights file, with floats converted to float32. Raises ModelError if it is missing or damaged."""
    data = read_bytes(path)
    try:
        stored = load(data)
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
        config = json.loads(header["__metadata__"]["config"])
    except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ModelError(f"{path}: not a weights file of this codec, or damaged; reinstall the package.") from error
    if not isinstance(config, dict):
        raise ModelError(f"{path}: its configuration is no JSON object; reinstall the package.")
    tensors = {name: value.float() if value.is_floating_point() else value for name, value in stored.items()}
    return Weights(tensors, config, model_id_of(data))


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Read the tensors of any safetensors file, floats as float32. Raises ModelError if it is missing or damaged."""
    try:
        stored = load(read_bytes(path))
    except SafetensorError as error:
        raise ModelError(f"{path}: not a safetensors file, or damaged; fetch or install it again.") from error
    return {name: value.float() if value.is_floating_point() else value for name, value in stored.items()}


def config_of(weights: Weights, end: str, like: Config, place: Path) -> Config:
    """Return the configuration of the "receiver" or the "sender" (`end`) that a weights file stores.

    like: a configuration of the expected class; it defines the names and types of the fields and the ranges of values.
    place: path of the file, for messages. Raises ModelError if the configuration is missing or does not match `like`.
    """
    stored = weights.config.get(end)
    if not isinstance(stored, dict):
        raise ModelError(f"{place}: holds no {end}; name a {end}'s weights file.")
    found = {name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()}
    expected = {field.name: getattr(like, field.name) for field in fields(like)}  # type: ignore[arg-type]
    found = {name: expected[name] for name in optional_fields(like) - found.keys()} | found
    if {name: _form(value) for name, value in found.items()} != {n: _form(value) for n, value in expected.items()}:
        raise ModelError(f"{place}: made by another version of the codec; install that version.")
    for name, value in found.items():
        if not is_in_range(value, expected[name]):
            raise ModelError(f"{place}: {name} in its configuration is out of range; reinstall the package.")
    return type(like)(**found)


def _form(value: object) -> object:
    return tuple(type(entry) for entry in value) if isinstance(value, tuple) else type(value)


def load_into(network: torch.nn.Module, tensors: dict[str, Tensor], place: Path) -> None:
    """Load tensors into a network. Raises ModelError unless their names and shapes match those of the network."""
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise ModelError(f"{place}: the weights do not fit this version's networks; reinstall the package.") from error
