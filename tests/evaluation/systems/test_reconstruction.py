"""How a system is run."""

import torch

from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.progress import ON_COMPILATION
from tests.example_scenes import example_views


def test_times_are_those_of_a_run_without_compilation() -> None:
    seconds = [16.0, 1.0, 2.0]

    def reconstruct(views: Views, num_context: int) -> Reconstruction:
        for tell in ON_COMPILATION if len(seconds) == 3 else ():
            tell()
        return Reconstruction(0, seconds.pop(0), 0.0, None, torch.zeros_like(views.images), None)

    system = System("slow at first", "", reconstruct)
    assert [system.run(example_views(2), 1, None).encode_seconds for _ in range(2)] == [1.0, 2.0]
    assert ON_COMPILATION == []
