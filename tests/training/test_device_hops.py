"""A training step with the paper's method keeps its tensors on the device: a pass on the meta device shows every hop
to the host. docs/paper_profile.md lists them.

The meta device has shapes and no values. Where the host reads a value, a fixed one is returned here, and the place is
recorded. The renderer is replaced, because there is none for this device, and precision is float32.
"""

import traceback
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.rasterizer import Rendering
from fecocodec.sender.model import Sender
from fecocodec.training import training_pass
from fecocodec.training.batch import Batch
from fecocodec.training.configurations import configuration_named
from fecocodec.training.training_pass import code_with_additive_noise, run_stages

DEVICE = "meta"
TINY = 1e-6  # what the host reads: equal intrinsics differ by less, and a near bound is positive


class Hops(TorchDispatchMode):
    """Records the functions of the package that read a value, copy a tensor to the host, or mix devices."""

    def __init__(self) -> None:
        super().__init__()
        self.found: Counter[str] = Counter()

    def __torch_dispatch__(
        self, operator: Any, types: Sequence[type], args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        tensors = [value for value in tree_leaves((args, kwargs)) if isinstance(value, Tensor)]
        on_device = [tensor for tensor in tensors if tensor.device.type == DEVICE]
        on_host = [tensor for tensor in tensors if tensor.device.type != DEVICE and tensor.ndim]
        if on_device and operator is torch.ops.aten._local_scalar_dense.default:
            self.found[f"read in {place()}"] += 1
            return TINY if on_device[0].is_floating_point() else 0
        if on_device and operator is torch.ops.aten._to_copy.default and is_host((kwargs or {}).get("device")):
            self.found[f"copied in {place()}"] += 1
            return torch.zeros(on_device[0].shape, dtype=on_device[0].dtype)
        if on_device and on_host:
            self.found[f"mixed in {place()}"] += 1
        return operator(*args, **(kwargs or {}))


def is_host(device: torch.device | None) -> bool:
    return device is not None and device.type == "cpu"


def place() -> str:
    """Return the innermost function of the package that is running."""
    frames = [frame for frame in traceback.extract_stack() if "/fecocodec/" in frame.filename]
    return frames[-1].name


def rendered(gaussians: Gaussians, cameras: Cameras, size: tuple[int, int]) -> Rendering:
    """Stand in for the renderer: images that depend on all fields."""
    level = torch.stack([field.mean() for field in gaussians.fields()]).sum()
    assert gaussians.means.device.type == cameras.extrinsics.device.type == DEVICE
    views = level.expand(cameras.num_views, *size)
    return Rendering(views[:, None].expand(-1, 3, -1, -1), views, views)


def batch_on_device(num_context: int, num_target: int, size: tuple[int, int]) -> Batch:
    views = num_context + num_target
    with torch.device(DEVICE):
        cameras = Cameras(torch.empty(1, views, 4, 4), torch.empty(1, views, 3, 3), torch.empty(1), torch.empty(1))
        images, depth = torch.empty(1, views, 3, *size), torch.empty(1, views, *size)
        return Batch(images, cameras, depth, num_context, torch.empty(1, dtype=torch.long))


def test_a_pass_of_the_paper_stays_on_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of eight views, the nearest are matched. The host reads whether intrinsics are equal, and the choice of source
    views in two places; see the page.
    """
    monkeypatch.setattr(training_pass, "render", rendered)
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())  # has no meta device
    configuration = configuration_named("paper-dl3dv")
    with torch.device(DEVICE):
        receiver, sender = Receiver(configuration.receiver), Sender(configuration.sender, configuration.receiver)
    batch = batch_on_device(8, 1, (64, 64))
    with Hops() as hops:
        coding = code_with_additive_noise(receiver, sender)
        stages, _ = run_stages(sender, receiver, batch, coding, 2, None, 0.0, has_all_targets=True)
        loss = sum(stage.images.mean() + stage.estimated_bits.mean() for stage in stages)
        loss.backward()
    assert loss.device.type == DEVICE and all(stage.images.device.type == DEVICE for stage in stages)
    assert set(hops.found) == {"copied in cost_volume", "copied in cross_view_consistency"}
    assert all(parameter.grad is not None for parameter in receiver.predictor.parameters())
