"""How much work an encoding is, counted: a change that repeats a part fails here, on a machine of any speed."""

from collections import Counter
from typing import Any

import pytest
import torch

import fecocodec.rendering.cpu as rasteriser
from fecocodec.checkpoint import model_folder
from fecocodec.container import quantise_lambda
from fecocodec.geometry.views import Views
from fecocodec.receiver.model import Receiver
from fecocodec.sender.codec import load_codec
from fecocodec.sender.encode import encode_with
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.training.synthetic.scenes import SyntheticScenes
from fecocodec.training.synthetic.textures import pattern_textures

SIZE = (64, 64)


@pytest.fixture(scope="module")
def views() -> Views:
    generator = torch.Generator().manual_seed(11)
    return SyntheticScenes(pattern_textures(8)).sample(generator, num_context=4, num_target=3, size=SIZE).views


@pytest.mark.parametrize(
    ("num_views", "num_guides", "lmbda", "most"),
    [
        (2, 0, 1e-3, {"match": 1, "predict": 8, "pictures": 2 * 8}),
        (2, 3, 1e-3, {"match": 1, "predict": 8, "pictures": 2 * 8 + 3 * 7}),
        (4, 3, 1e-3, {"match": 1, "predict": 8, "pictures": 4 * 8 + 3 * 7 + 7 * 10}),
        (2, 0, 1e-4, {"match": 1, "predict": 8, "pictures": 2 * 8 + 2 * 14}),
    ],
)
def test_parts_of_an_encoding(
    views: Views,
    num_views: int,
    num_guides: int,
    lmbda: float,
    most: dict[str, int],
    monkeypatch: pytest.MonkeyPatch,
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
    codec = load_codec(model_folder(None), "cpu")
    encode_with(codec, views.select(list(range(num_views))), quantise_lambda(lmbda), guides=guides)
    assert counts == most
