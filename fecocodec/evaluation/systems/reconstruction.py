"""Interface of the systems under comparison: context views -> images at all cameras of an entry."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.progress import ON_COMPILATION


@dataclass(frozen=True)
class Reconstruction:
    """The output of a receiver.

    num_bytes: size of all transmitted data, cameras included. encode_seconds, decode_seconds: without rendering.
    gaussians: None if the receiver has none. images: at the cameras of all views, context views first, sRGB in [0, 1].
    depth: along the optical axis in scene units, 0 where nothing is rendered; None if there is no depth. num_guides:
    photographs that the sender learned from; guides that it left out do not count. warnings: sentences of the sender.
    """

    num_bytes: int
    encode_seconds: float
    decode_seconds: float
    gaussians: Gaussians | None
    images: Float[Tensor, "view 3 height width"]
    depth: Float[Tensor, "view height width"] | None
    num_guides: int = 0
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class System:
    """One operating point of one method.

    name: of the method; systems with the same name form a curve. setting: operating point, such as "lambda 1e-3".
    reconstruct: (views, number of context views) -> reconstruction. It uses only the cameras of the target views, not
    their images, unless documented otherwise. learn: (views, number of context views, guides) -> reconstruction of a
    system whose sender learns from photographs that are not coded; None for others, which never see them.
    """

    name: str
    setting: str
    reconstruct: Callable[[Views, int], Reconstruction]
    learn: Callable[[Views, int, Views], Reconstruction] | None = None

    def run(self, views: Views, num_context: int, guides: Views | None) -> Reconstruction:
        """Return the reconstruction. guides: of the entry, None for none.

        A run that compiles kernels, which happens once a machine, is repeated, so that its times are without that.
        """
        run = partial(self.reconstruct, views, num_context)
        if guides is not None and self.learn is not None:
            run = partial(self.learn, views, num_context, guides)
        compiled: list[None] = []
        on_compilation = partial(compiled.append, None)
        ON_COMPILATION.append(on_compilation)
        try:
            found = run()
        finally:
            ON_COMPILATION.remove(on_compilation)
        return run() if compiled else found
