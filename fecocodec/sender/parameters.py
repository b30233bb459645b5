"""Number of parameters of each module, and the side that needs it."""

from dataclasses import dataclass

import torch
from torch import nn

from fecocodec.config import CodecConfig, PaperSenderConfig, ReceiverConfig, SenderConfig
from fecocodec.errors import InputError
from fecocodec.receiver.model import Receiver
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender


@dataclass(frozen=True)
class ParameterRow:
    """Size of a module.

    side: "receiver" for modules that `decode` loads (the sender needs them too), "sender" for the others, "sum".
    """

    module: str
    side: str
    parameters: int


RECEIVER_SUM, SENDER_SUM = "receiver, all that decode loads", "sender, all that encode loads"
PUBLISHED = {RECEIVER_SUM: 3.45e6, SENDER_SUM: 37.28e6}  # the paper's Table 1
_PROFILES: dict[str, CodecConfig] = {"compact": SenderConfig(), "paper": PaperSenderConfig()}


def parameter_table(profile: str = "compact") -> tuple[ParameterRow, ...]:
    """The modules of a profile ("compact" or "paper"), then the receiver's sum and the whole sender's with it.

    The paper's extractor is shown part by part. Raises InputError for a profile that does not exist.
    """
    if profile not in _PROFILES:
        raise InputError(f"There is no profile '{profile}'; choose one of {', '.join(_PROFILES)}.")
    config = ReceiverConfig()
    with torch.device("meta"):  # sizes without memory
        receiver, sender = Receiver(config), Sender(_PROFILES[profile], config)
    modules = [("receiver", name, module) for name, module in receiver.named_children()]
    modules += [("sender", name, module) for name, module in _parts(sender)]
    rows = [ParameterRow(name, side, _count(module)) for side, name, module in modules]
    rows.append(ParameterRow(RECEIVER_SUM, "sum", _count(receiver)))
    rows.append(ParameterRow(SENDER_SUM, "sum", _count(receiver) + _count(sender)))
    return tuple(rows)


def _parts(sender: Sender) -> list[tuple[str, nn.Module]]:
    """The sender's modules; an extractor of named parts is given as those."""
    parts = []
    for name, module in sender.named_children():
        if isinstance(module, DepthSplatSmall):
            parts += [(f"{name}.{part}", inner) for part, inner in module.named_children()]
        else:
            parts.append((name, module))
    return parts


def _count(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())
