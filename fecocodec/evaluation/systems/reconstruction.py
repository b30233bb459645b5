"""Systems under comparison: from context views to images at every camera of an entry."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class Reconstruction:
    """The output of a receiver.

    num_bytes: of everything sent, cameras included. gaussians: None where the receiver has none. images: at
    the cameras of all views, context views first, sRGB in [0, 1]. depth: along the optical axis in scene units, 0 where
    nothing is seen, None where there is none. Seconds: rendering is part of neither.
    """

    num_bytes: int
    encode_seconds: float
    decode_seconds: float
    gaussians: Gaussians | None
    images: Float[Tensor, "view 3 height width"]
    depth: Float[Tensor, "view height width"] | None


@dataclass(frozen=True)
class System:
    """One operating point of one method.

    name: of the method; the systems of one name are a curve. setting: the operating point, such as "lambda 1e-3".
    reconstruct: (views, number of context views) -> reconstruction; of the target views it may use the cameras only,
    unless its documentation says otherwise.
    """

    name: str
    setting: str
    reconstruct: Callable[[Views, int], Reconstruction]
