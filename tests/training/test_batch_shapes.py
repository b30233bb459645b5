"""Shapes of batches: what is drawn, how often, and how much a batch may cost."""

from collections import Counter

import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.training.batch import BatchShape, BatchShapes
from fecocodec.training.configurations import CONFIGURATIONS

SQUARE = (128, 128)


def drawn(shapes: BatchShapes, count: int = 400) -> list[BatchShape]:
    generator = torch.Generator().manual_seed(0)
    return [shapes.draw(generator) for _ in range(count)]


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_no_batch_of_a_named_configuration_exceeds_the_usual_one(name: str) -> None:
    shapes = CONFIGURATIONS[name].shapes
    for shape in drawn(shapes):
        pixels = shape.num_scenes * (shape.num_context + shape.num_target) * shape.size[0] * shape.size[1]
        assert 0.5 * shapes.most_pixels <= pixels <= shapes.most_pixels


def test_shapes_that_are_drawn() -> None:
    shapes = BatchShapes(2, ((2, 1.0),), 2, (SQUARE,))
    generator = torch.Generator().manual_seed(3)
    before = generator.get_state()
    assert shapes.draw(generator) == BatchShape(2, 2, 2, SQUARE) == shapes.usual
    assert torch.equal(generator.get_state(), before)
    shapes = BatchShapes(4, ((2, 1.0), (6, 1.0)), 2, (SQUARE,))
    assert {(shape.num_context, shape.num_scenes) for shape in drawn(shapes, 40)} == {(2, 4), (6, 2)}
    shapes = CONFIGURATIONS["compact"].shapes
    batches = drawn(shapes, 1500)
    counts = Counter(shape.num_context for shape in batches)
    assert 0.6 < counts[2] / len(batches) < 0.72
    assert set(counts) == {2, 3, 4, 6, 8}
    assert {shape.size for shape in batches} == set(shapes.sizes)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((1, ((2, 1.0),), 2, ((100, 128),)), r"side of 100 pixels cannot be used; choose a multiple of 32 from 64"),
        ((1, ((2, 1.0),), 2, ((128, 1056),)), r"side of 1056 pixels cannot be used"),
        ((1, ((17, 1.0),), 2, (SQUARE,)), r"17 context views .* give 1 to 16 views"),
        ((1, ((2, 0.0),), 2, (SQUARE,)), r"share 0 .* positive shares"),
        ((1, ((2, 1.0), (8, 1.0)), 2, (SQUARE,)), r"8 context views exceed .* give a smaller size too"),
        ((0, ((2, 1.0),), 2, (SQUARE,)), r"give at least one of each"),
        ((1, ((2, 1.0),), 0, (SQUARE,)), r"give at least one of each"),
    ],
)
def test_shapes_that_cannot_be_trained_are_named(arguments: tuple, sentence: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=sentence):
        BatchShapes(*arguments)
