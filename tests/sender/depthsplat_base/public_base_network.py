"""The public DepthSplat-Base's reference outputs, and weights for its tensors.

`public_base_tensors.json` has name and shape of every tensor of the public network (MIT licence) up to its features.
`public_base_outputs.npz` has outputs of it for two synthetic views and synthetic weights, thinned out: some channels
(`CHANNEL_STEPS`), every third row and column. No trained weights are in either.
"""

import json
import zlib
from pathlib import Path

import torch
from torch import Tensor

from fecocodec.sender.extractors.depthsplat_base.extractor import DepthSplatBase
from tests.sender.depthsplat_small.public_network import made_up_tensor, undrawn

HERE = Path(__file__).parent
SHIPPED = HERE / "public_base_outputs.npz"
SHAPES: dict[str, list[int]] = json.loads((HERE / "public_base_tensors.json").read_text())
PARAMETERS = {
    "depth_predictor.backbone": 1_049_120,
    "depth_predictor.transformer": 3_150_336,
    "depth_predictor.mv_pyramid": 69_760,
    "depth_predictor.pretrained": 86_579_712,
    "depth_predictor.mono_pyramid": 2_507_520,
    "depth_predictor.regressor.0": 6_895_872,
    "depth_predictor.regressor_residual.0": 147_584,
    "depth_predictor.depth_head.0": 590_208,
    "depth_predictor.regressor.1": 2_114_304,
    "depth_predictor.regressor_residual.1": 36_928,
    "depth_predictor.depth_head.1": 110_752,
    "depth_predictor.upsampler": 7_913_049,
    "feature_upsampler": 9_420_576,
}  # of each module; they add up to 120,585,721
CHANNEL_STEPS = {
    "features_cnn_0": 8, "features_cnn_1": 8, "features_mv_0": 8, "features_mv_1": 8, "features_mono_0": 16,
    "features_mono_1": 32, "match_prob_0": 8, "match_prob_1": 8, "depth": 1, "features": 24,
}  # fmt: skip


def made_up_network() -> DepthSplatBase:
    """The network with the synthetic weights of the reference outputs."""
    with undrawn():
        network = DepthSplatBase()
    weights = {name: made_up_tensor(name.removeprefix("depth_predictor."), shape) for name, shape in SHAPES.items()}
    network.load_state_dict(weights, assign=True)
    return network.requires_grad_(False)


def shapes_at_8() -> dict[str, list[int]]:
    """Shapes of the network that matches at 1/8 and 1/4, by what it joins at 1/2, 1/4 and 1/8."""
    found = dict(SHAPES)
    for head, depth in (("depth_predictor.upsampler", 1), ("feature_upsampler", 0)):
        found[f"{head}.concat_projects.0.weight"] = [96, 64 + 96, 1, 1]
        found[f"{head}.concat_projects.1.weight"] = [192, 96 + 192 + 64 + depth, 1, 1]
        found[f"{head}.concat_projects.2.weight"] = [384, 128 + 384 + 128, 1, 1]
    return found


def constant_weights(seed: str = "", shapes: dict[str, list[int]] = SHAPES) -> dict[str, Tensor]:
    """One number per tensor, under the names of official checkpoints. Saved, they take no space."""
    values = {name: (zlib.crc32((seed + name).encode()) / 2**32 - 0.5) / 200 for name in shapes}
    return {f"encoder.{name}": torch.tensor(values[name]).expand(shape) for name, shape in shapes.items()}


def write_checkpoint(path: Path, seed: str = "") -> Path:
    """Write `constant_weights` as an official checkpoint, with a tensor that nothing here uses."""
    torch.save({"state_dict": constant_weights(seed) | {"encoder.gaussian_head.0.bias": torch.zeros(8)}}, path)
    return path
