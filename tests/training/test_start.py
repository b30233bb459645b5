"""What differs from the paper's start is said: random weights of the extractor, and another batch."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from fecosplat_cli.train import remarks_on_start, totals

from fecocodec.receiver.model import Receiver
from fecocodec.sender.model import Sender
from fecocodec.training.configurations import configuration_named

RANDOM = (
    "the extractor starts from random weights, the paper's from those of DepthSplat; give its file, or those of DINOv2 "
    "and GMFlow, by `extractor_weights`."
)
FILE = Path("depthsplat.pth")


def test_what_differs_from_the_papers_start_is_said() -> None:
    assert remarks_on_start(configuration_named("paper-re10k"), 4, [FILE]) == ()
    assert remarks_on_start(configuration_named("compact"), 1, []) == ()
    configuration = configuration_named("paper-re10k")
    for scenes, processes, words in ((1, 1, "1 scene,"), (2, 1, "2 scenes,"), (4, 2, "8 scenes,")):
        found = replace(configuration, shapes=replace(configuration.shapes, num_scenes=scenes))
        (remark,) = remarks_on_start(found, processes, [FILE])
        assert remark.startswith(f"a step has {words} the paper's 4; start 4 processes by torchrun, or set the scenes")
    four = replace(configuration, shapes=replace(configuration.shapes, num_scenes=4))
    assert remarks_on_start(four, 1, [FILE]) == () and remarks_on_start(four, 1, []) == (RANDOM,)


@pytest.mark.parametrize(
    ("name", "at_receiver", "in_all"),
    [("ablate-no-feedback", 3_472_413, 37_325_469), ("ablate-gaussians-full", 3_531_237, 37_384_293)],
)
def test_ablations_keep_the_widths_and_print_their_totals(name: str, at_receiver: int, in_all: int) -> None:
    configuration = configuration_named(name)
    with torch.device("meta"):
        receiver, sender = Receiver(configuration.receiver), Sender(configuration.sender, configuration.receiver)
    assert totals(receiver, sender) == f"{at_receiver:,} parameters at the receiver, {in_all:,} in all"
