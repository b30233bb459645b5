"""Number of parameters of each module of sender and receiver."""

from dataclasses import dataclass, replace

import torch
from torch import nn

from fecocodec.config import COMPACT_SENDER, PAPER_RECEIVER, PAPER_SENDER, CodecConfig, ReceiverConfig
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
PUBLISHED = {RECEIVER_SUM: 3.45e6, SENDER_SUM: 37.28e6}  # the paper's Table 1
SHIPPED_DETAIL_PLANES = 64
_PROFILES: dict[str, tuple[CodecConfig, ReceiverConfig]] = {
    "compact": (replace(COMPACT_SENDER, has_sharp_steps=True), ReceiverConfig(detail_planes=SHIPPED_DETAIL_PLANES)),
    "paper": (PAPER_SENDER, PAPER_RECEIVER),
}


def parameter_table(profile: str = "compact") -> tuple[ParameterRow, ...]:
    """Return one row per module of a profile ("compact" or "paper"), then the totals of `decode` and of `encode`.

    The extractor of the paper has one row per submodule. Raises InputError for an unknown profile.
    """
    if profile not in _PROFILES:
        raise InputError(f"There is no profile '{profile}'; choose one of {', '.join(_PROFILES)}.")
    config, of_receiver = _PROFILES[profile]
    with torch.device("meta"):  # shapes without allocation
        receiver, sender = Receiver(of_receiver), Sender(config, of_receiver)
    modules = [("receiver", name, module) for name, module in receiver.named_children()]
    modules += [("sender", name, module) for name, module in _parts(sender, profile == "paper")]
    rows = [ParameterRow(name, side, _count(module)) for side, name, module in modules]
    rows.append(ParameterRow(RECEIVER_SUM, "sum", _count(receiver)))
    rows.append(ParameterRow(SENDER_SUM, "sum", _count(receiver) + _count(sender)))
    return tuple(rows)


def _parts(sender: Sender, is_split: bool) -> list[tuple[str, nn.Module]]:
    """Return the modules of the sender by name. is_split: list the submodules of the extractor."""
    parts = []
    for name, module in sender.named_children():
        if is_split and name == "extractor":
            parts += [(f"{name}.{part}", inner) for part, inner in module.named_children()]
        else:
            parts.append((name, module))
    return parts


def _count(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())
