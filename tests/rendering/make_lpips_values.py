"""Write `lpips_values.json` with the original package: python tests/rendering/make_lpips_values.py FOLDER WEIGHTS.

FOLDER: where `pip install --no-deps --target FOLDER lpips==0.1.4 torchvision tqdm` has put them. WEIGHTS: folder with
the trunks in fp16, `lpips_vgg16.safetensors` and `lpips_alexnet.safetensors`. The package's own heads are used. Nothing
is downloaded.
"""

import json
import sys
from pathlib import Path
from unittest.mock import patch

import torch
from safetensors.torch import load_file

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.rendering.picture_pairs import picture_pairs  # noqa: E402


def main(folder: str, weights: str) -> None:
    """Compute the distances with the package's network and heads, and the trunks of the weights folder."""
    sys.path.insert(0, folder)
    with patch("torch.library.register_fake", lambda _name: lambda function: function):  # of torchvision's own kernels
        from lpips import LPIPS

    values = {}
    for trunk, net in (("vgg16", "vgg"), ("alexnet", "alex")):
        metric = LPIPS(net=net, pnet_rand=True, verbose=False).eval()
        tensors = load_file(Path(weights, f"lpips_{trunk}.safetensors"))
        convolutions = [module for module in metric.net.modules() if isinstance(module, torch.nn.Conv2d)]
        for number, convolution in enumerate(convolutions):
            for name in ("weight", "bias"):
                getattr(convolution, name).data.copy_(tensors[f"conv{number}.{name}"])
        with torch.no_grad():
            values[trunk] = {name: float(metric(*pair, normalize=True)) for name, pair in picture_pairs().items()}
    (HERE / "lpips_values.json").write_text(json.dumps(values, indent=1) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
