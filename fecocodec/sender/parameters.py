"""Number of parameters of each module of sender and receiver."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import nn

from fecocodec.config import (
    COMPACT_SENDER,
    PAPER_RECEIVER,
    PAPER_SENDER,
    CodecConfig,
    LargeSenderConfig,
    ReceiverConfig,
)
from fecocodec.errors import InputError
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender


@dataclass(frozen=True)
class ParameterRow:
    """Number of parameters of a module.

    side: "receiver" for modules that `decode` loads (the sender loads them too), "sender" for the other modules, "sum"
    for totals.
    """

    module: str
    side: str
    parameters: int


RECEIVER_SUM, SENDER_SUM = "receiver, all that decode loads", "sender, all that encode loads"
PUBLISHED = {  # the paper's Table 1
    "paper": {RECEIVER_SUM: 3.45e6, SENDER_SUM: 37.28e6},
    "paper-large": {RECEIVER_SUM: 3.45e6, SENDER_SUM: 126.11e6},
}
SHIPPED_DETAIL_PLANES = 64
_PROFILES: dict[str, tuple[CodecConfig, ReceiverConfig]] = {
    "compact": (replace(COMPACT_SENDER, has_sharp_steps=True), ReceiverConfig(detail_planes=SHIPPED_DETAIL_PLANES)),
    "paper": (PAPER_SENDER, PAPER_RECEIVER),
    "paper-large": (LargeSenderConfig(), PAPER_RECEIVER),
}


def parameter_table(profile: str = "compact") -> tuple[ParameterRow, ...]:
    """Return one row per module of a profile, see `_PROFILES`, then the totals of `decode` and of `encode`.

    The extractors of the paper have one row per submodule. Raises InputError for an unknown profile.
    """
    if profile not in _PROFILES:
        raise InputError(f"There is no profile '{profile}'; choose one of {', '.join(_PROFILES)}.")
    config, of_receiver = _PROFILES[profile]
    with torch.device("meta"):  # shapes without allocation
        receiver, sender = Receiver(of_receiver), Sender(config, of_receiver)
    modules = [("receiver", name, module) for name, module in receiver.named_children()]
    modules += [("sender", name, module) for name, module in _parts(sender, profile in PUBLISHED)]
    rows = [ParameterRow(name, side, count_parameters(module)) for side, name, module in modules]
    rows.append(ParameterRow(RECEIVER_SUM, "sum", count_parameters(receiver)))
    rows.append(ParameterRow(SENDER_SUM, "sum", count_parameters(receiver) + count_parameters(sender)))
    return tuple(rows)


def _parts(sender: Sender, is_split: bool) -> list[tuple[str, nn.Module]]:
    """Return the modules of the sender by name. is_split: list the submodules of the extractor."""
    parts: list[tuple[str, nn.Module]] = []
    for name, module in sender.named_children():
        if is_split and name == "extractor":
            parts += _split(name, module)
        else:
            parts.append((name, module))
    return parts


def _split(name: str, module: nn.Module) -> Iterator[tuple[str, nn.Module]]:
    """Yield the submodules of an extractor, those of a frozen one and of its depth predictor."""
    for part, inner in (pair for network in _with_frozen(module) for pair in network.named_children()):
        if part == "depth_predictor":
            yield from _split(f"{name}.{part}", inner)
        else:
            yield f"{name}.{part}", inner


def count_parameters(network: nn.Module) -> int:
    """Return the number of parameters of a network, with those of a frozen extractor that is a module."""
    return sum(parameter.numel() for part in _with_frozen(network) for parameter in part.parameters())


def _with_frozen(network: nn.Module) -> list[nn.Module]:
    frozen = getattr(getattr(network, "extractor", network), "frozen", None)
    return [network, frozen] if isinstance(frozen, nn.Module) else [network]
