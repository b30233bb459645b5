"""The kernels against a brute-force renderer, forward and backward."""

import pytest
import torch
from brute_force import render_brute_force
from small_scenes import random_gaussians, two_cameras

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import Rendering, render

IMAGE_SIZE = (38, 67)  # two by three tiles, the last ones cut by the border
BACKGROUND = (0.2, 0.5, 0.9)
FIELDS = ("means", "scales", "rotations", "opacities", "harmonics")
OUTPUTS = ("color", "depth", "alpha")


def exact(gaussians: Gaussians) -> Gaussians:
    """The same numbers in float64, asking for gradients."""
    return Gaussians(*(field.double().requires_grad_() for field in gaussians.fields()))


def images_of(rendering: Rendering) -> tuple[torch.Tensor, ...]:
    return rendering.color, rendering.depth, rendering.alpha


@pytest.mark.parametrize("num_harmonics", [1, 4, 9, 16])
def test_images_equal_the_textbook(num_harmonics: int) -> None:
    gaussians = random_gaussians(40, num_harmonics)
    rendering = render(gaussians, two_cameras(), IMAGE_SIZE, BACKGROUND)
    color, depth, alpha = render_brute_force(exact(gaussians), two_cameras(), IMAGE_SIZE, BACKGROUND)
    torch.testing.assert_close(rendering.color.double(), color, atol=1e-5, rtol=0)
    torch.testing.assert_close(rendering.depth.double(), depth, atol=1e-4, rtol=0)
    torch.testing.assert_close(rendering.alpha.double(), alpha, atol=1e-5, rtol=0)


@pytest.fixture(scope="module")
def gradients() -> dict[str, tuple[tuple[torch.Tensor, ...], tuple[torch.Tensor, ...]]]:
    """Per output, the gradients of a random projection of it by every field: (ours, textbook)."""
    leaves = exact(random_gaussians(40, num_harmonics=16, seed=1))
    ours = images_of(render(leaves, two_cameras(), IMAGE_SIZE, BACKGROUND))
    textbook = render_brute_force(leaves, two_cameras(), IMAGE_SIZE, BACKGROUND)
    gradients = {}
    for output, image, expected in zip(OUTPUTS, ours, textbook, strict=True):
        weight = torch.randn(expected.shape, generator=torch.Generator().manual_seed(2)).double()
        options = {"retain_graph": True, "allow_unused": True, "materialize_grads": True}
        gradients[output] = (
            torch.autograd.grad((image * weight).sum(), leaves.fields(), **options),
            torch.autograd.grad((expected * weight).sum(), leaves.fields(), **options),
        )
    return gradients


@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("field", FIELDS)
def test_gradients_equal_the_textbook(gradients, output: str, field: str) -> None:
    ours, textbook = (side[FIELDS.index(field)] for side in gradients[output])
    assert (ours - textbook).norm() <= 1e-4 * textbook.norm()
    assert (textbook.norm() > 0) == (field != "harmonics" or output == "color")


def test_gradient_of_all_outputs_together_is_the_sum(gradients) -> None:
    leaves = exact(random_gaussians(40, num_harmonics=16, seed=1))
    images = images_of(render(leaves, two_cameras(), IMAGE_SIZE, BACKGROUND))
    loss = sum(
        (image * torch.randn(image.shape, generator=torch.Generator().manual_seed(2)).double()).sum()
        for image in images
    )
    together = torch.autograd.grad(loss, leaves.fields())
    for index, gradient in enumerate(together):
        expected = sum(gradients[output][1][index] for output in OUTPUTS)
        assert (gradient - expected).norm() <= 1e-4 * expected.norm()


def test_nearer_gaussian_hides_the_one_behind_whatever_their_order() -> None:
    solid = {"scales": torch.full((2, 3), 0.5), "opacities": torch.full((2,), 0.999)}
    means, harmonics = torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, 4.0]]), torch.tensor([[[1.0] * 3], [[-1.0] * 3]])
    rotations = torch.tensor([[1.0, 0.0, 0.0, 0.0]] * 2)
    camera = two_cameras().select([0])
    first = render(Gaussians(means, rotations=rotations, harmonics=harmonics, **solid), camera, (16, 16))
    flipped = Gaussians(means.flip(0), rotations=rotations, harmonics=harmonics.flip(0), **solid)
    assert torch.equal(first.color, render(flipped, camera, (16, 16)).color)
    assert abs(first.depth[0, 8, 8].item() - 2.0) < 0.05


def test_thread_count_changes_no_bit() -> None:
    before = torch.get_num_threads()
    results = []
    try:
        for num_threads in (1, 2, 3):
            torch.set_num_threads(num_threads)
            leaves = Gaussians(*(field.requires_grad_() for field in random_gaussians(500).fields()))
            rendering = render(leaves, two_cameras(), (70, 90))
            loss = rendering.color.square().sum() + rendering.depth.sum() + rendering.alpha.sum()
            results.append((*images_of(rendering), *torch.autograd.grad(loss, leaves.fields())))
    finally:
        torch.set_num_threads(before)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))
