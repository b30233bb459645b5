"""Public weights for the extractor, loaded by name: official DepthSplat checkpoints, Depth Anything V2, UniMatch.

A checkpoint is a dict of tensors, or holds one as "state_dict" or "model". Official DepthSplat keys begin with
`encoder.depth_predictor.`; Depth Anything V2 has `pretrained.*`, UniMatch `backbone.*` and `transformer.*`, and both
initialise a part only.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from fecocodec.errors import ModelError
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

OFFICIAL_PREFIX = "encoder.depth_predictor."
_NESTED = ("state_dict", "model")


@dataclass(frozen=True)
class LoadReport:
    """Names of tensors: used ones as the extractor calls them, unused ones as the file does, and those not found."""

    used: tuple[str, ...]
    unused: tuple[str, ...]
    missing: tuple[str, ...]

    def __str__(self) -> str:
        parts = sorted({name.split(".")[0] for name in self.missing})
        missing = f"{len(self.missing)} missing ({', '.join(parts)})" if parts else "0 missing"
        return f"{len(self.used)} tensors used, {len(self.unused)} unused, {missing}"


def load_public_weights(extractor: DepthSplatSmall, path: Path) -> LoadReport:
    """Copy every tensor of the file that the extractor has by that name; says which were used, unused and missing.

    Raises ModelError where the file is unreadable, a tensor has another shape, none is of use, or an official
    checkpoint lacks one or meets an extractor without the public geometry that it was trained with.
    """
    stored = _read(path)
    is_official = any(name.startswith(OFFICIAL_PREFIX) for name in stored)
    if is_official and extractor.geometry != "public":
        raise ModelError(
            f"{path}: was trained with the public code's geometry, this extractor has {extractor.geometry!r}; "
            "build it with geometry 'public'."
        )
    renamed = {_own_name(name): name for name in stored}
    wanted = extractor.state_dict()
    used = [name for name in wanted if name in renamed]
    missing = tuple(name for name in wanted if name not in renamed)
    if not used:
        raise ModelError(f"{path}: no tensor of it belongs to depthsplat-small; name another checkpoint.")
    if is_official and missing:
        raise ModelError(f"{path}: lacks {len(missing)} tensors such as {missing[0]}; fetch DepthSplat-Small's file.")
    for name in used:
        found, expected = tuple(stored[renamed[name]].shape), tuple(wanted[name].shape)
        if found != expected:
            raise ModelError(f"{path}: {name} is {found}, but {expected} here; fetch the weights of the small variant.")
    extractor.load_state_dict({name: stored[renamed[name]] for name in used}, strict=False)
    taken = {renamed[name] for name in used}
    return LoadReport(tuple(used), tuple(name for name in stored if name not in taken), missing)


def _own_name(name: str) -> str:
    return name.removeprefix(OFFICIAL_PREFIX)


def _read(path: Path) -> dict[str, Tensor]:
    """All tensors of a checkpoint by name, without running anything that it holds."""
    if not path.is_file():
        raise ModelError(f"{path}: no such checkpoint; check the path.")
    try:
        contents = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can fail in every way there is
        raise ModelError(
            f"{path}: no checkpoint, damaged, or with more than tensors in it ({type(error).__name__}); "
            "store its state_dict alone with torch.save."
        ) from error
    for name in _NESTED:
        if isinstance(contents, Mapping) and isinstance(contents.get(name), Mapping):
            contents = contents[name]
    tensors = contents.items() if isinstance(contents, Mapping) else ()
    return {str(name): value for name, value in tensors if isinstance(value, Tensor)}
