"""How many parameters each module has, and which side needs it."""

from dataclasses import dataclass

from torch import nn

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender


@dataclass(frozen=True)
class ParameterRow:
    """Size of a module.

    side: "receiver" for what `decode` loads (the sender needs it too), "sender" for what only `encode` loads, "sum".
    """

    module: str
    side: str
    parameters: int


def parameter_table() -> tuple[ParameterRow, ...]:
    """The compact profile's modules, then the receiver's sum and the whole sender's (the receiver's included)."""
    config = ReceiverConfig()
    receiver, sender = Receiver(config), Sender(SenderConfig(), config)
    rows = [
        ParameterRow(name, side, _count(module))
        for side, network in (("receiver", receiver), ("sender", sender))
        for name, module in network.named_children()
    ]
    rows.append(ParameterRow("receiver, all that decode loads", "sum", _count(receiver)))
    rows.append(ParameterRow("sender, all that encode loads", "sum", _count(receiver) + _count(sender)))
    return tuple(rows)


def _count(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())
