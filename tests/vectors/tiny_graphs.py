"""Graphs of the entropy model of the test vectors. `python -m tests.vectors.tiny_graphs [FOLDER]` exports them."""

import sys
from functools import cache
from pathlib import Path

from fecocodec.runtime.graphs import Graphs
from fecocodec.training.graphs.exported_forms import with_exported_forms
from tests.vectors.tiny_model import TINY_MODEL, empty_prior, load_prior, tiny_model_id

FOLDER = Path(__file__).parent / "tiny_graphs"


@cache
def tiny_graphs(num_threads: int = 1) -> Graphs:
    return Graphs(TINY_MODEL.read_bytes(), FOLDER, tiny_model_id(), num_threads)


def export_tiny_graphs(folder: Path) -> None:
    from fecocodec.training.graphs.export import write_graphs
    from fecocodec.training.graphs.specification import prior_graphs

    weights = TINY_MODEL.read_bytes()
    write_graphs(prior_graphs(with_exported_forms(load_prior(weights, empty_prior()))), weights, folder)


if __name__ == "__main__":
    export_tiny_graphs(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
