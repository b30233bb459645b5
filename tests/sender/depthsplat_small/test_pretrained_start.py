"""Weights of other networks are a better start than random ones: GMFlow's CNN and transformer on real pairs."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from fecocodec.captures.evaluation_index import read_index
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.model_files import DEFAULT_MODEL, SHIPPED
from fecocodec.sender.codec import load_codec
from fecocodec.sender.extractors.depthsplat_small.checkpoint import load_public_weights
from fecocodec.sender.extractors.depthsplat_small.cost_volume import NUM_CANDIDATES
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

SHARED = Path(__file__).parents[4] / "shared"
GMFLOW, DINOV2 = (SHARED / "weights" / f"{name}.safetensors" for name in ("gmflow_refine", "dinov2_vits14"))
DEV = SHARED / "data" / "dev"
NUM_PAIRS, SIDE = 4, 128
NEAR_ENOUGH = 0.03  # of relative disparity
needs_data = pytest.mark.skipif(not (GMFLOW.is_file() and DINOV2.is_file() and DEV.is_dir()), reason="needs `shared`")


def drawn() -> DepthSplatSmall:
    torch.manual_seed(0)
    return DepthSplatSmall().eval().requires_grad_(False)


@needs_data
def test_two_files_fill_all_but_the_fusion() -> None:
    extractor = drawn()
    of_dino, of_gmflow = (load_public_weights(extractor, path) for path in (DINOV2, GMFLOW))
    assert of_dino.unused == () and {name.split(".")[0] for name in of_dino.used} == {"pretrained"}
    unused = {name.split(".")[0] for name in of_gmflow.unused}
    assert unused == {"feature_flow_attn", "upsampler"}
    left = set(of_dino.missing) & set(of_gmflow.missing)
    assert {name.split(".")[0] for name in left} == {"regressor", "regressor_residual"}


@needs_data
@torch.inference_mode()
def test_matching_of_real_pairs_is_better_than_from_random_weights() -> None:
    """Measured by the share of positions that agree with the shipped model's matching where it is consistent.

    The multi-view transformer expects features that the 3x3 convolution of its network has seen: without the product
    of both convolutions, matching is worse than at random.
    """
    random, loaded, by_name = drawn(), drawn(), drawn()
    load_public_weights(loaded, GMFLOW)
    by_name.load_state_dict(loaded.state_dict())
    by_name.backbone.conv2.load_state_dict(plain_convolution())
    found = torch.tensor([shares_of_agreement(index, (random, loaded, by_name)) for index in range(NUM_PAIRS)])
    at_random, with_weights, unfolded = found.mean(dim=0).tolist()
    assert with_weights > at_random + 0.1 and unfolded < at_random, found  # measured: see docs/paper_profile.md


def plain_convolution() -> dict[str, Tensor]:
    from fecocodec.checkpoint import read_tensors

    stored = read_tensors(GMFLOW)
    return {name: stored[f"backbone.conv2.{name}"] for name in ("weight", "bias")}


def shares_of_agreement(index: int, extractors: tuple[DepthSplatSmall, ...]) -> list[float]:
    """Return the share for each extractor, on a pair of the dev scenes."""
    entries = [entry for entry in read_index(SHARED / "data" / "dev_index.json") if len(entry.context) == 2]
    views = open_scenes(DEV, (SIDE, SIDE))(entries[index * len(entries) // NUM_PAIRS]).select([0, 1])
    cameras = normalise_scene(views.cameras)[0].as_batch()
    reference = load_codec(SHIPPED / DEFAULT_MODEL, "cpu").sender.extractor.match(views.images[None], cameras).depth
    is_sure = reference.consistency > 0.5
    assert float(is_sure.float().mean()) > 0.1
    shares = []
    for extractor in extractors:
        best = extractor.match(views.images[None], cameras).cost.argmax(dim=1, keepdim=True) / (NUM_CANDIDATES - 1)
        is_near = (best - reference.relative_disparity).abs() < NEAR_ENOUGH
        shares.append(float(is_near[is_sure].float().mean()))
    return shares
