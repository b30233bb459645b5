"""DINOv2 as 8-bit weights: the shipped file, what rounding costs, and files that are wrong."""

from pathlib import Path

import pytest
import torch
from safetensors.torch import load, save_file

from fecocodec.errors import ModelError
from fecocodec.photographs.images import read_image
from fecocodec.sender.extractors.dinov2 import FEATURES, FILE, dinov2_features, load_dinov2, serialise_dinov2
from fecocodec.sender.extractors.vision_transformer import VisionTransformer, normalised

PHOTOGRAPH = Path(__file__).parents[2] / "examples" / "motorcycle" / "images" / "left.png"
LARGEST_ERROR = 0.03  # of features, relative root mean square


def photograph(side: int) -> torch.Tensor:
    """A crop of the bundled photograph: `1 3 side side`."""
    return read_image(PHOTOGRAPH)[None, :, :side, :side]


@pytest.fixture(scope="module")
def network() -> VisionTransformer:
    """A network whose blocks do something, as after training."""
    torch.manual_seed(4)
    network = VisionTransformer().eval().requires_grad_(False)
    for name, value in network.state_dict().items():
        if name.endswith("gamma"):
            value.fill_(1.0)
    return network


def test_the_shipped_file_is_small_and_has_its_licence_beside_it() -> None:
    assert FILE.stat().st_size < 23_000_000
    assert "Apache License" in (FILE.parent / "LICENSE").read_text()


def test_features_of_the_shipped_weights_tell_patches_apart() -> None:
    pictures = torch.cat((photograph(252), photograph(252).flip(-1)))
    features = dinov2_features(pictures)
    assert features.shape == (2, FEATURES, 18, 18) and features.isfinite().all()
    last = features[:, FEATURES // 2 :]
    mirrored = (last[0] - last[1].flip(-1)).square().mean()
    assert mirrored < 0.5 * (last[0] - last[1]).square().mean()  # like the picture, unlike chance


def test_sides_of_the_picture_decide_the_grid_of_patches() -> None:
    assert dinov2_features(torch.rand(1, 3, 64, 128)).shape[-2:] == (13, 25)


def test_rounding_to_8_bits_changes_features_little(network: VisionTransformer, tmp_path: Path) -> None:
    path = tmp_path / "backbone.safetensors"
    path.write_bytes(serialise_dinov2(network))
    images = normalised(photograph(56))
    exact, rounded = (it.after_blocks(images, (9, 12)) for it in (network, load_dinov2(path)))
    for a, b in zip(exact, rounded, strict=True):
        assert 0.0 < ((a - b).square().mean() / a.square().mean()).sqrt() < LARGEST_ERROR


def test_features_after_the_last_block_are_those_of_the_network(network: VisionTransformer) -> None:
    images = normalised(photograph(56))
    assert torch.equal(network.after_blocks(images, (9, 12))[1], network(images))


def test_scales_that_are_missing_are_named(network: VisionTransformer, tmp_path: Path) -> None:
    tensors = load(serialise_dinov2(network))
    del tensors["blocks.3.mlp.fc1.weight.scale"]
    path = tmp_path / "backbone.safetensors"
    save_file(tensors, path)
    with pytest.raises(ModelError, match=r"scales of tensor 'blocks.3.mlp.fc1.weight'"):
        load_dinov2(path)


def test_a_package_without_the_file_says_where_it_is(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="packages leave them out"):
        load_dinov2(tmp_path / "backbone.safetensors")
