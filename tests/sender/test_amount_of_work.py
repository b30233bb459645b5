"""How much work an encoding is, counted: a change that repeats a part fails here, on a machine of any speed.

One thread and two give equal bytes and equal Gaussians.
"""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

import fecocodec.rendering.cpu as rasteriser
from fecocodec.container import quantise_lambda
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode
from fecocodec.receiver.model import Receiver
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode, encode_with
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.optimisation_config import DEFAULT
from tests.example_scenes import MODEL, example_views, synthetic_views

FEW_STEPS = replace(DEFAULT.with_steps(2), detail_steps_per_decade=0)


@pytest.fixture(scope="module")
def views() -> Views:
    return synthetic_views(4, 3, (64, 64))


@pytest.mark.parametrize(
    ("num_views", "num_guides", "lmbda", "most"),
    [
        (2, 3, 1e-3, {"match": 1, "predict": 8, "pictures": 2 * 8 + 3 * 7}),
        (4, 3, 1e-3, {"match": 1, "predict": 8, "pictures": 4 * 8 + 3 * 7 + 7 * 10}),
        (2, 0, 1e-4, {"match": 1, "predict": 8, "pictures": 2 * 8 + 2 * 14}),
    ],
)
def test_parts_of_an_encoding(
    views: Views, shipped_codec: Codec, num_views: int, num_guides: int, lmbda: float, most: dict[str, int], monkeypatch
) -> None:
    """match: of the views. predict: passes of the predictor. pictures: rendered, with or without gradients."""
    counts = Counter[str]()

    def count(owner: Any, name: str, part: str, size: Any = lambda *_arguments: 1) -> None:
        original = getattr(owner, name)

        def counted(*arguments: Any, **options: Any) -> Any:
            counts[part] += size(*arguments)
            return original(*arguments, **options)

        monkeypatch.setattr(owner, name, counted)

    count(CompactExtractor, "match", "match")
    count(Receiver, "predict", "predict")
    count(rasteriser, "_project", "pictures")
    guides = views.select(list(range(4, 4 + num_guides))) if num_guides else None
    encode_with(shipped_codec, views.select(list(range(num_views))), quantise_lambda(lmbda), guides=guides)
    assert counts == most


def coded_with(count: int, model: Path, num_views: int) -> tuple[bytes, Gaussians]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        data = encode(example_views(num_views), lmbda=1e-4, effort=FEW_STEPS, model=model)
        return data, decode(data, model=model).gaussians
    finally:
        torch.set_num_threads(before)


def test_the_number_of_threads_changes_no_bit(random_weights: Path) -> None:
    """Of so many views that they fade, too."""
    (data, gaussians), (data_of_two, gaussians_of_two) = (coded_with(n, random_weights / MODEL, 5) for n in (1, 2))
    assert data_of_two == data
    for one, two in zip(gaussians.fields(), gaussians_of_two.fields(), strict=True):
        assert torch.equal(one, two)
