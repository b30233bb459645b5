"""Invalid Gaussians and inputs: not drawn, or refused with an InputError."""

import math
from pathlib import Path

import pytest
import torch
from small_scenes import random_gaussians, two_cameras

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.kernels.compilation import compiled
from fecocodec.rendering import cpu, tiles
from fecocodec.rendering.rasterizer import _check, render

IMAGE_SIZE = (40, 50)
BACKGROUND = (0.25, 0.5, 0.75)
FIELDS = ("means", "scales", "rotations", "opacities", "harmonics")


def with_value(gaussians: Gaussians, index: int, **values: float) -> Gaussians:
    """A copy in which every number of these fields of one Gaussian has this value."""
    fields = {name: getattr(gaussians, name).clone() for name in FIELDS}
    for name, value in values.items():
        fields[name][index] = value
    return Gaussians(**fields)


def without(gaussians: Gaussians, index: int) -> Gaussians:
    return gaussians.keep(torch.arange(gaussians.count) != index)


def test_where_nothing_is_drawn_the_background_shows() -> None:
    rendering = render(random_gaussians(0), two_cameras(), IMAGE_SIZE, BACKGROUND)
    assert torch.equal(rendering.color, torch.tensor(BACKGROUND)[:, None, None].expand(2, 3, *IMAGE_SIZE))
    assert not rendering.depth.any()
    assert not rendering.alpha.any()
    gaussians = random_gaussians(30)
    cameras = two_cameras().select([0])
    moved = gaussians.means.clone()
    moved[:15, 2] *= -1.0
    moved[15:, 2] = 0.099 * float(cameras.near)
    hidden = Gaussians(moved, *gaussians.fields()[1:])
    assert not render(hidden, cameras, IMAGE_SIZE).alpha.any()


@pytest.mark.parametrize(
    ("field", "value"),
    [(field, value) for field in FIELDS for value in (math.nan, math.inf, -math.inf)]
    + [("means", 1e38), ("scales", 1e38), ("harmonics", 1e38)],
)
def test_a_broken_gaussian_is_not_drawn(field: str, value: float) -> None:
    gaussians = random_gaussians(30)
    broken = Gaussians(*(f.requires_grad_() for f in with_value(gaussians, 7, **{field: value}).fields()))
    rendering = render(broken, two_cameras(), IMAGE_SIZE, BACKGROUND)
    expected = render(without(gaussians, 7), two_cameras(), IMAGE_SIZE, BACKGROUND)
    assert torch.equal(rendering.color, expected.color)
    assert torch.equal(rendering.depth, expected.depth)
    for gradient in torch.autograd.grad(rendering.color.sum() + rendering.depth.sum(), broken.fields()):
        assert gradient.isfinite().all()
        assert not gradient[7].any()


@pytest.mark.parametrize(
    "values",
    [{"rotations": 0.0}, {"opacities": 0.0}, {"opacities": 1 / 255}, {"opacities": -1.0}],
    ids=["quaternion 0", "opacity 0", "opacity 1/255", "opacity -1"],
)
def test_an_invisible_gaussian_changes_nothing(values: dict[str, float]) -> None:
    gaussians = random_gaussians(30)
    rendering = render(with_value(gaussians, 3, **values), two_cameras(), IMAGE_SIZE)
    assert torch.equal(rendering.color, render(without(gaussians, 3), two_cameras(), IMAGE_SIZE).color)


def test_a_gaussian_without_extent_is_a_dot_as_wide_as_the_dilation() -> None:
    gaussians = with_value(random_gaussians(1), 0, means=0.0, scales=0.0, opacities=0.9)
    gaussians.means[0, 2] = 2.0
    centred = Cameras(
        torch.eye(4)[None],
        torch.tensor([[[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]]]),
        torch.tensor(0.5),
        torch.tensor(9.0),
    )
    alpha = render(gaussians, centred, (9, 9)).alpha[0]
    assert alpha[4, 4].item() == pytest.approx(0.9, rel=1e-5)
    assert alpha[4, 5].item() == pytest.approx(0.9 * math.exp(-0.5 / 0.3), rel=1e-4)
    assert alpha[4, 7] == 0


def test_gaussians_far_larger_than_the_image_cover_it_evenly() -> None:
    gaussians = with_value(random_gaussians(5), 0, scales=1e6)
    gaussians = Gaussians(gaussians.means, torch.full_like(gaussians.scales, 1e5), *gaussians.fields()[2:])
    gaussians = Gaussians(*gaussians.fields()[:3], torch.full((5,), 0.5), gaussians.harmonics)
    alpha = render(gaussians, two_cameras().select([0]), IMAGE_SIZE).alpha
    torch.testing.assert_close(alpha, torch.full_like(alpha, 1 - 0.5**5), atol=1e-4, rtol=0)


def test_centres_far_outside_the_image_with_matching_radii_do_no_harm() -> None:
    """Where float32 no longer resolves a pixel, tiles and rows must still stay inside the image."""
    gaussians = random_gaussians(200)
    far = torch.logspace(2, 9, 200)[:, None]
    gaussians = Gaussians(gaussians.means * far, gaussians.scales * far, *gaussians.fields()[2:])
    sideways = Gaussians(torch.cat((gaussians.means[:, :2] * 10, torch.ones(200, 1)), dim=-1), *gaussians.fields()[1:])
    leaves = Gaussians(*(field.requires_grad_() for field in sideways.fields()))
    rendering = render(leaves, two_cameras(), IMAGE_SIZE)
    assert rendering.color.isfinite().all()
    for gradient in torch.autograd.grad(rendering.color.sum(), leaves.fields()):
        assert gradient.isfinite().all()


def test_many_hits_are_worked_through_in_parts_with_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    leaves = Gaussians(*(field.requires_grad_() for field in random_gaussians(100).fields()))

    def color_and_gradients() -> tuple[torch.Tensor, ...]:
        color = render(leaves, two_cameras(), IMAGE_SIZE).color
        return color.detach(), *torch.autograd.grad(color.square().sum(), leaves.fields())

    at_once = color_and_gradients()
    monkeypatch.setattr(tiles, "_MAX_HITS", 50)
    in_parts = color_and_gradients()
    assert all(torch.equal(a, b) for a, b in zip(at_once, in_parts, strict=True))


def test_gradients_take_the_lists_of_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(cpu, "tile_lists", lambda *given, make=cpu.tile_lists: made.append(given) or make(*given))
    leaves = Gaussians(*(field.requires_grad_() for field in random_gaussians(100).fields()))
    render(leaves, two_cameras(), IMAGE_SIZE).color.sum().backward()
    assert len(made) == 2  # one for each camera
    assert leaves.opacities.grad.abs().sum() > 0


def test_lists_hold_no_more_hits_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "_MAX_HITS", 50)
    held = []
    monkeypatch.setattr(
        tiles, "TileLists", lambda *fields, make=tiles.TileLists: held.append(len(fields[-1])) or make(*fields)
    )
    wide = random_gaussians(40)
    wide = Gaussians(wide.means, torch.full_like(wide.scales, 100.0), *wide.fields()[2:])
    render(wide, two_cameras(), IMAGE_SIZE)
    assert len(held) == 2 * 4  # cameras, tiles
    assert max(held) <= 50


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image_size": (0, 8)}, "An image of height 0 and width 8 has no pixels; make both positive."),
        ({"num_harmonics": 5}, "Gaussians carry 5 harmonics a colour; use 1, 4, 9 or 16 (degree 0 to 3)."),
        ({"near": 0.0}, "The near bound of the cameras is 0.0; it must be a positive depth."),
        ({"device": "meta"}, "Gaussians on device 'meta' cannot be rendered; move them to 'cpu' or 'cuda'."),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_unusable_inputs_are_refused(change: dict, message: str) -> None:
    gaussians = random_gaussians(3, change.get("num_harmonics", 4)).to(change.get("device", "cpu"))
    cameras = two_cameras()
    cameras = Cameras(cameras.extrinsics, cameras.intrinsics, torch.tensor(change.get("near", 0.5)), cameras.far)
    with pytest.raises(InputError) as refused:
        render(gaussians, cameras, change.get("image_size", (8, 8)))
    assert str(refused.value) == message


@pytest.mark.parametrize("field", FIELDS)
def test_fields_of_other_lengths_are_refused(field: str) -> None:
    """Kernels would read beyond the end of an array. The tests' type checks would refuse such Gaussians before."""
    gaussians = random_gaussians(9)
    object.__setattr__(gaussians, field, getattr(gaussians, field)[:5])
    named = "scales" if field == "means" else field  # the means set the number
    with pytest.raises(InputError, match=rf"`{named}` of the Gaussians has the shape \(\d, ?.*\); with \d means it"):
        _check(gaussians, two_cameras(), (8, 8))


def test_a_camera_that_is_not_finite_is_refused() -> None:
    cameras = two_cameras()
    broken = Cameras(cameras.extrinsics * torch.nan, *cameras.fields()[1:])
    with pytest.raises(InputError, match="a camera holds a value that is not finite; correct its pose and intrinsics"):
        render(random_gaussians(3), broken, (8, 8))


def test_a_batch_of_scenes_is_refused() -> None:
    batch = Gaussians(*(field[None] for field in random_gaussians(3).fields()))
    with pytest.raises(InputError, match="render the scenes of a batch one by one"):
        render(batch, two_cameras(), (8, 8))


def test_kernels_compile_where_no_cache_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.core.caching.FunctionCache._impl_class._locator_classes", [])
    assert compiled(_twice)(21) == 42


def test_the_first_compilation_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    told: list[int] = []
    monkeypatch.setattr("fecocodec.kernels.compilation.ON_COMPILATION", [lambda: told.append(len(told))])
    assert compiled(_twice)(21) == compiled(_twice)(21) == 42
    assert told == [0]  # the second one was read from the cache


def _twice(number: int) -> int:
    return 2 * number
