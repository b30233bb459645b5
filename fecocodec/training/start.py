"""What is to be said at the start of a run: size of the networks, and what is not as in the paper."""

from collections.abc import Sequence
from pathlib import Path

from torch import nn

from fecocodec.training.configurations import Configuration

PAPER_BATCH = 4  # scenes a step in all processes (paper, implementation details)


def totals(receiver: nn.Module, sender: nn.Module) -> str:
    """Return the numbers of parameters that the paper's Table 1 gives."""
    of_receiver, of_sender = (sum(p.numel() for p in network.parameters()) for network in (receiver, sender))
    return f"{of_receiver:,} parameters at the receiver, {of_receiver + of_sender:,} in all"


def remarks_on_start(configuration: Configuration, num_processes: int, weights: Sequence[Path]) -> tuple[str, ...]:
    """Return a sentence for each difference from the paper's start; none for other methods.

    weights: sources of initial weights of the extractor, empty for random ones.
    """
    if not configuration.is_paper:
        return ()
    remarks = []
    if not weights and configuration.sender.extractor == "depthsplat-small":
        remarks.append(
            "the extractor starts from random weights, the paper's from those of DepthSplat; give its file, or those "
            "of DINOv2 and GMFlow, by `extractor_weights`."
        )
    batch = configuration.shapes.num_scenes * num_processes
    if batch != PAPER_BATCH:
        remarks.append(
            f"a step has {batch} scene{'s' * (batch > 1)}, the paper's {PAPER_BATCH}; start {PAPER_BATCH} processes by "
            "torchrun, or set the scenes of each by `num_scenes`."
        )
    return tuple(remarks)
