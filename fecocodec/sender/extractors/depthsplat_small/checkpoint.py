"""Load public weights into an extractor by name: DepthSplat, Depth Anything V2, DINOv2, UniMatch and GMFlow.

A checkpoint is a dict of tensors, or contains one as "state_dict" or "model". Keys of official DepthSplat checkpoints
begin with `encoder.`. Depth Anything V2 (`pretrained.*`), UniMatch and GMFlow (`backbone.*`, `transformer.*`)
initialise only a part of the small extractor, as DINOv2 does (`blocks.*`, ViT-S/14, with the names of
Transformers or of DINOv2), in `.safetensors` files too.

Networks of two scales end their CNN with a 3x3 convolution for each (`backbone.trident_conv`), on which the transformer
was trained. This CNN has none, so its last 1x1 convolution becomes their product, with the taps of the 3x3 one added
up. Without it, matching is worse than from random weights (docs/paper_profile.md).
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from fecocodec.checkpoint import read_tensors
from fecocodec.errors import ModelError
from fecocodec.sender.extractors.depthsplat_base.extractor import DepthSplatBase
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

ENCODER, PREDICTOR = "encoder.", "depth_predictor."
OFFICIAL_PREFIX = ENCODER + PREDICTOR
# Part of the name of the one published small checkpoint that saw DL3DV. Its features have 1/8 resolution.
_COARSE_NAME = "re10kdl3dv-448x768"
_COARSE_WARNING = "it was trained with features at 1/8 resolution and is used at 1/4, so train it further"
_JOINED, _JOINED_AT_8 = "feature_upsampler.concat_projects.0.weight", 160  # its inputs with matching at 1/8 and 1/4
_NESTED = ("state_dict", "model")
_LAST, _TRIDENT = "backbone.conv2", "backbone.trident_conv.weight"
_DINO_STARTS = (
    "blocks.", "norm.", "patch_embed", "class_token", "cls_token", "position_embedding", "pos_embed",
)  # fmt: skip
_DINO_NAMES = (  # stored, in the extractor
    ("attention.output", "attn.proj"),
    ("attention.qkv", "attn.qkv"),
    ("layer_scale1", "ls1.gamma"),
    ("layer_scale2", "ls2.gamma"),
    ("class_token", "cls_token"),
    ("position_embedding", "pos_embed"),
    ("patch_embedding.", "patch_embed.proj."),
)


@dataclass(frozen=True)
class LoadReport:
    """Tensor names. used, missing: names in the extractor. unused: names in the file. warning: one sentence, or ""."""

    used: tuple[str, ...]
    unused: tuple[str, ...]
    missing: tuple[str, ...]
    warning: str = ""

    def table(self) -> tuple[str, ...]:
        """Return a row per part of the extractor and of the file: tensors used, unused (in the file) and missing."""
        used, unused, missing = (Counter(map(_part, names)) for names in (self.used, self.unused, self.missing))
        rows = [
            f"{part:20}{used[part]:>6}{unused[part]:>8}{missing[part]:>9}" for part in sorted(used | unused | missing)
        ]
        return (f"{'part':20}{'used':>6}{'unused':>8}{'missing':>9}", *rows)

    def __str__(self) -> str:
        parts = sorted(set(map(_part, self.missing)))
        missing = f"{len(self.missing)} missing ({', '.join(parts)})" if parts else "0 missing"
        text = f"{len(self.used)} tensors used, {len(self.unused)} unused, {missing}"
        return f"{text}; {self.warning}" if self.warning else text


def load_public_weights(extractor: DepthSplatSmall | DepthSplatBase, path: Path) -> LoadReport:
    """Copy every tensor of the file whose name exists in the extractor. Returns the used, unused and missing names.

    Raises ModelError if the file cannot be read, if a tensor has another shape, or if no name matches. For an official
    DepthSplat checkpoint, also if a tensor is missing, or if the extractor does not have the "public" geometry. For the
    larger extractor, which is frozen, a tensor must never be missing.
    """
    is_large = isinstance(extractor, DepthSplatBase)
    size, prefix = ("base", ENCODER) if is_large else ("small", OFFICIAL_PREFIX)
    stored = _with_folded_trident(_read(path))
    is_official = any(name.startswith(OFFICIAL_PREFIX) for name in stored)
    if isinstance(extractor, DepthSplatSmall) and is_official and extractor.geometry != "public":
        raise ModelError(
            f"{path}: was trained with the public code's geometry, this extractor has {extractor.geometry!r}; "
            "build it with geometry 'public'."
        )
    renamed = {_own_name(name, prefix): name for name in stored}
    if isinstance(extractor, DepthSplatBase) and _JOINED in renamed:
        extractor.arrange(8 if stored[renamed[_JOINED]].shape[1:2] == (_JOINED_AT_8,) else 4)
    stored = {name: value.float() if value.is_floating_point() else value for name, value in stored.items()}
    wanted = extractor.state_dict()
    used = [name for name in wanted if name in renamed]
    missing = tuple(name for name in wanted if name not in renamed)
    if not used:
        raise ModelError(f"{path}: no tensor of it belongs to depthsplat-{size}; name another checkpoint.")
    if (is_official or is_large) and missing:
        raise ModelError(f"{path}: lacks {len(missing)} tensors such as {missing[0]}; fetch that of depthsplat-{size}.")
    for name in used:
        found, expected = tuple(stored[renamed[name]].shape), tuple(wanted[name].shape)
        if found != expected:
            raise ModelError(f"{path}: {name} is {found}, but {expected} here; take the weights of the {size} variant.")
    extractor.load_state_dict({name: stored[renamed[name]] for name in used}, strict=False, assign=is_large)
    taken = {renamed[name] for name in used}
    unused = tuple(name for name in stored if name not in taken)
    return LoadReport(tuple(used), unused, missing, _COARSE_WARNING if _COARSE_NAME in path.name else "")


def _with_folded_trident(stored: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors with the last convolution of a CNN of two scales as a part of the one before it."""
    weight, bias, trident = (stored.get(name) for name in (f"{_LAST}.weight", f"{_LAST}.bias", _TRIDENT))
    if trident is None or weight is None or bias is None:
        return stored
    summed = trident.float().sum(dim=(2, 3))
    folded = {f"{_LAST}.weight": (summed @ weight.float().flatten(1))[..., None, None]}
    folded[f"{_LAST}.bias"] = summed @ bias.float()
    return {name: value for name, value in stored.items() if name != _TRIDENT} | folded


def _part(name: str) -> str:
    """Return the part of the extractor that a tensor belongs to."""
    return name.removeprefix(ENCODER).removeprefix(PREDICTOR).split(".")[0]


def _own_name(name: str, prefix: str) -> str:
    """Return the name of a stored tensor in the extractor; names that match nothing are left as they are."""
    if name.startswith(_DINO_STARTS):
        for stored, own in _DINO_NAMES:
            name = name.replace(stored, own)
        return f"pretrained.{name}"
    return name.removeprefix(prefix)


def _read(path: Path) -> dict[str, Tensor]:
    """Read all tensors of a checkpoint by name, without executing pickled code."""
    if not path.is_file():
        raise ModelError(f"{path}: no such checkpoint; check the path.")
    if path.suffix == ".safetensors":
        return read_tensors(path)
    try:
        contents = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can raise any exception
        raise ModelError(
            f"{path}: no checkpoint, damaged, or with more than tensors in it ({type(error).__name__}); "
            "store its state_dict alone with torch.save."
        ) from error
    for name in _NESTED:
        if isinstance(contents, Mapping) and isinstance(contents.get(name), Mapping):
            contents = contents[name]
    tensors = contents.items() if isinstance(contents, Mapping) else ()
    return {str(name): value for name, value in tensors if isinstance(value, Tensor)}
