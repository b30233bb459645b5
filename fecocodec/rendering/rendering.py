"""Result of rendering."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Rendering:
    """Images of Gaussians, with blending weights w.

    color: sRGB, at least 0, over the background. depth: expected depth sum(w z) / sum(w) along the optical axis in
    scene units, 0 where no Gaussian is drawn. alpha: accumulated opacity sum(w) in [0, 1].
    """

    color: Float[Tensor, "view 3 height width"]
    depth: Float[Tensor, "view height width"]
    alpha: Float[Tensor, "view height width"]
