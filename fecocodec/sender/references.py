"""What the optimisation compares renderings with: the photographs of one scene, coded ones first, then guides.

Cut-outs are compared on white and on black: judged on white alone, a white Gaussian at a silhouette is as good as none,
and shows as a rim on every other background.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import joined_masks
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.scene_encoder import SceneEncoder

Pictures = Float[Tensor, "picture 3 h w"]
MAX_GUIDES_AT_ONCE = 8  # in one step; more take turns. Four of eight lose 0.3 dB with four coded views
PerPicture = Callable[[Pictures, Pictures], Float[Tensor, " picture"]]  # (renderings, photographs) -> D of each


@dataclass(frozen=True)
class References:
    """Photographs of one scene with their cameras.

    images: sRGB in [0, 1]; cut-outs on white. transparency: 1 - opacity of cut-outs; None for opaque photographs.
    num_context: number of context views, which come first. ignored: pixels that masks mark, where no rendering differs
    from its photograph; None without masks.
    """

    cameras: Cameras
    images: Float[Tensor, "view 3 h w"]
    transparency: Float[Tensor, "view 1 h w"] | None
    num_context: int
    ignored: Bool[Tensor, "view h w"] | None = None

    @staticmethod
    def of(encoder: SceneEncoder) -> "References":
        """Return the context views of the encoder's scene, then its guides."""
        cameras, images = encoder.cameras.scene(0), encoder.images[0]
        transparency = None if encoder.cut_out is None else encoder.cut_out.transparency
        if (guides := encoder.guides) is None:
            return References(cameras, images, transparency, len(images), encoder.ignored)
        if transparency is not None:
            of_guides = guides.transparency
            transparency = torch.cat((transparency, of_guides if of_guides is not None else 0 * guides.images[:, :1]))
        joined, both = cameras.joined(guides.cameras), torch.cat((images, guides.images))
        ignored = joined_masks([(encoder.ignored, images), (guides.ignored, guides.images)])
        return References(joined, both, transparency, len(images), ignored)

    @property
    def num_guides(self) -> int:
        return len(self.images) - self.num_context

    def taught(self, number: int) -> "References":
        """Return the context views and the share of the guides that teaches in turn `number`.

        Shares take every second, third, ... guide, so that each spreads over the scene; all turns together use all.
        """
        shares = -(-self.num_guides // MAX_GUIDES_AT_ONCE)
        if shares <= 1:
            return self
        views = [*range(self.num_context), *range(self.num_context + number % shares, len(self.images), shares)]
        transparency, ignored = (None if x is None else x[views] for x in (self.transparency, self.ignored))
        cameras, images = self.cameras.select(views), self.images[views]
        return replace(self, cameras=cameras, images=images, transparency=transparency, ignored=ignored)

    @property
    def pictures(self) -> Pictures:
        """Return the photographs; cut-outs on white, then on black."""
        if self.transparency is None:
            return self.images
        return torch.cat((self.images, self.images - self.transparency))

    def rendered(self, gaussians: Gaussians) -> Pictures:
        """Return the renderings of the Gaussians that correspond to `pictures`; these where masks mark pixels."""
        rendering = render(gaussians, self.cameras, (self.images.shape[-2], self.images.shape[-1]))
        rendered = rendering.color
        if self.transparency is not None:
            rendered = torch.cat((rendered + (1.0 - rendering.alpha[:, None]), rendered))
        if self.ignored is None:
            return rendered
        ignored = self.ignored.repeat(len(rendered) // len(self.ignored), 1, 1)[:, None]
        return torch.where(ignored, self.pictures, rendered)

    def distortion(self, gaussians: Gaussians, of_picture: PerPicture) -> tuple[Float[Tensor, ""], Pictures]:
        """Return the mean D over all pictures, with a graph to the Gaussians, and the renderings without one."""
        pictures = self.rendered(gaussians)
        return of_picture(pictures, self.pictures).mean(), pictures.detach()
