"""Write `st_lpips_values.json` with the original package: python tests/rendering/make_st_lpips_values.py FOLDER.

FOLDER: where `pip install --no-deps --target FOLDER stlpips_pytorch==0.0.2` has put it. The modules that the package
imports but does not use (torchvision, torchsummary, IPython) are replaced by empty ones.
"""

import json
import sys
from pathlib import Path
from unittest.mock import MagicMock

import torch

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.rendering.picture_pairs import picture_pairs  # noqa: E402


def main(folder: str) -> None:
    """Compute the distances with the package's own float32 weights."""
    for name in ("torchvision", "torchvision.models", "torchsummary", "IPython"):
        sys.modules.setdefault(name, MagicMock())
    sys.path.insert(0, folder)
    from stlpips_pytorch.stlpips import LPIPS

    metric = LPIPS(net="alex", variant="shift_tolerant", verbose=False)
    with torch.no_grad():
        values = {name: float(metric(*pair, normalize=True)) for name, pair in picture_pairs().items()}
    (HERE / "st_lpips_values.json").write_text(json.dumps(values, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
