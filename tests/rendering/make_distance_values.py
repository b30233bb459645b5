"""Write `lpips_values.json` or `st_lpips_values.json` with the original packages, without a download.

    python tests/rendering/make_distance_values.py FOLDER          with ST-LPIPS and its own weights in float32
    python tests/rendering/make_distance_values.py FOLDER WEIGHTS  with LPIPS and its own heads

FOLDER: where `pip install --no-deps --target FOLDER stlpips_pytorch==0.0.2`, or `lpips==0.1.4 torchvision tqdm`, has
put them. WEIGHTS: folder with the trunks in fp16, `lpips_vgg16.safetensors` and `lpips_alexnet.safetensors`.
"""

import json
import sys
from pathlib import Path
from unittest.mock import MagicMock, patch

import torch
from safetensors.torch import load_file

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.rendering.picture_pairs import picture_pairs  # noqa: E402


@torch.no_grad()
def distances(metric: torch.nn.Module) -> dict[str, float]:
    return {name: float(metric(*pair, normalize=True)) for name, pair in picture_pairs().items()}


def of_st_lpips() -> dict[str, float]:
    """Modules that the package imports but does not use are replaced by empty ones."""
    for name in ("torchvision", "torchvision.models", "torchsummary", "IPython"):
        sys.modules.setdefault(name, MagicMock())
    from stlpips_pytorch.stlpips import LPIPS

    return distances(LPIPS(net="alex", variant="shift_tolerant", verbose=False))


def of_lpips(weights: str, trunk: str, net: str) -> dict[str, float]:
    with patch("torch.library.register_fake", lambda _name: lambda function: function):  # of torchvision's own kernels
        from lpips import LPIPS

    metric = LPIPS(net=net, pnet_rand=True, verbose=False).eval()
    tensors = load_file(Path(weights, f"lpips_{trunk}.safetensors"))
    convolutions = [module for module in metric.net.modules() if isinstance(module, torch.nn.Conv2d)]
    for number, convolution in enumerate(convolutions):
        for name in ("weight", "bias"):
            getattr(convolution, name).data.copy_(tensors[f"conv{number}.{name}"])
    return distances(metric)


if __name__ == "__main__":
    folder, *weights = sys.argv[1:]
    sys.path.insert(0, folder)
    trunks = (("vgg16", "vgg"), ("alexnet", "alex"))
    values = {trunk: of_lpips(*weights, trunk, net) for trunk, net in trunks} if weights else of_st_lpips()
    file = HERE / ("lpips_values.json" if weights else "st_lpips_values.json")
    file.write_text(json.dumps(values, indent=1) + "\n")
