"""A whole receiver of the paper's method with few channels and made-up weights, with its graphs, beside the vectors.

`python -m tests.vectors.paper_model` draws it again and exports its graphs, which is necessary only after a change of
the architecture.
"""

from functools import cache
from random import Random

import torch

from fecocodec.atomic import make_folder
from fecocodec.checkpoint import RECEIVER_FILE, model_id_of, serialise_weights
from fecocodec.coding.fixed_point import export_integers
from fecocodec.config import PAPER, ReceiverConfig, stored_fields
from fecocodec.receiver.model import PRIOR, Receiver
from tests.vectors.tiny_model import VECTORS, random_like

PAPER_MODEL = VECTORS / "paper"
CONFIG = ReceiverConfig(
    method=PAPER,
    state_channels=4,
    latent_channels=8,
    hyper_channels=4,
    synthesis_channels=4,
    synthesis_depth=1,
    fine_hidden=4,
    predictor_channels=(4, 4),
    num_neighbours=4,
    attention_channels=4,
    prior_channels=4,
    sh_degree=2,
)


def make_paper_model(config: ReceiverConfig = CONFIG) -> bytes:
    """Return a weights file whose Gaussians vary with the symbols. The stored file is normative, not this function.

    Configurations with the same entropy model have the same integers, and so decode the same symbols.
    """
    torch.manual_seed(20261128)
    receiver, random = Receiver(config), Random(20261128)
    floats = {name: value for name, value in receiver.state_dict().items() if not name.startswith(PRIOR)}
    for name in ("predictor.head.2.weight", "predictor.depth_head.weight", "embedding.mlp.0.weight"):
        floats[name] = 8.0 * floats[name]
    integers = export_integers(receiver.prior)
    made = {PRIOR + name: random_like(name, integers[name], random) for name in sorted(integers)}
    return serialise_weights(floats | made, {"receiver": stored_fields(config)})


@cache
def paper_model_id() -> bytes:
    return model_id_of((PAPER_MODEL / RECEIVER_FILE).read_bytes())


if __name__ == "__main__":
    from fecocodec.training.graphs.export import export_receiver

    make_folder(PAPER_MODEL)
    (PAPER_MODEL / RECEIVER_FILE).write_bytes(make_paper_model())
    export_receiver(PAPER_MODEL)
