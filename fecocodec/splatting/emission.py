"""`emit`: the Gaussians of a prediction, by all rules in their order. No weights, no bits.

    attributes -> free-space check -> duplicates -> colours by direction -> coverage and fading -> culling -> merging
    -> layer outside all images -> layer behind near surfaces -> Gaussians

FORMAT.md, sections 9.1 and 9.2, define the rules. `decode` applies all of them. Sender and training call the same
function; what they leave out is an argument of `Emission`, which names the reason.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussian_arrays import ALPHA_MIN
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.limits import MAX_SH_DEGREE
from fecocodec.merging.grouping import MergingConfig
from fecocodec.merging.merge import merged_fields
from fecocodec.splatting.attributes import Attributes
from fecocodec.splatting.background import BackgroundConfig, append, background_layer
from fecocodec.splatting.duplicates import kept_share
from fecocodec.splatting.free_space import free_space_violation
from fecocodec.splatting.occluded import occluded_layer
from fecocodec.splatting.view_dependence import view_dependent


def merged(
    gaussians: Gaussians, is_present: Bool[Tensor, " n"], grid: tuple[int, int], cameras: Cameras, config: MergingConfig
) -> Gaussians:
    """Return `merged_fields`, computed on the CPU. cameras: of the views, in the frame of the Gaussians."""
    arrays = tuple(field.cpu().numpy() for field in gaussians.fields())
    poses = (cameras.extrinsics.cpu().numpy(), cameras.intrinsics.cpu().numpy())
    found = merged_fields(arrays, is_present.cpu().numpy(), grid, *poses, config)
    return Gaussians(*(torch.from_numpy(field) for field in found)).to(gaussians.means.device)


@dataclass(frozen=True)
class Prediction:
    """Output of P: attributes of Gaussians on their grid, and relative disparity on the 1/4 grid.

    The grid has `gaussians_per_side` rows and columns per cell of the 1/4 grid: the 1/2 grid for two.
    """

    attributes: Attributes
    relative_disparity: Float[Tensor, "batch view h4 w4"]

    def scene(self, index: int) -> "Prediction":
        return Prediction(self.attributes.scene(index), self.relative_disparity[index : index + 1])


@dataclass(frozen=True)
class Emission:
    """What `emit` leaves out or adds. The defaults are those of the sender's feedback.

    visibility: factors in [0, 1] of opacities by coverage and fading, ordered (view, row, column); None for 1.
    sh_degree: largest degree of the harmonics; higher coefficients are left out. has_fitted_colours: fit colours by
    direction; the sender does not in its optimisation, where they would compensate depth errors. is_culled: remove
    Gaussians that renderers skip; the sender keeps them, because its gradients and masks need all Gaussians in their
    order. background: layer outside all images, None for no layer; the sender leaves it out, because no context view
    shows it. is_filled: add the layer behind near surfaces, see `is_filled_behind`. merging: merge similar neighbours
    of culled Gaussians, on the CPU; None for no merging. Only models with rules have fits, layers and merging.
    """

    visibility: Float[Tensor, " n"] | None = None
    sh_degree: int = MAX_SH_DEGREE
    has_fitted_colours: bool = True
    is_culled: bool = False
    background: BackgroundConfig | None = None
    is_filled: bool = False
    merging: MergingConfig | None = None


def emit(prediction: Prediction, cameras: Cameras, config: ReceiverConfig, emission: Emission) -> Gaussians:
    """Return the Gaussians of one scene in the frame of the cameras; those of the layers come last.

    prediction, cameras: of a batch of one scene. cameras: of the context views, normalised. The layers have no
    gradient.
    """
    found, of_scene = prediction.attributes, cameras.scene(0)
    grid = (found.opacity.shape[-2], found.opacity.shape[-1])
    if config.kind.has_rules:
        found = fade_contradicted(found, cameras, config)
    plain = found.gaussians().scene(0)
    gaussians = plain
    if config.kind.has_rules and emission.has_fitted_colours and emission.sh_degree:
        gaussians = view_dependent(plain, of_scene, grid, config)
    gaussians = replace(gaussians, harmonics=gaussians.harmonics[:, : (emission.sh_degree + 1) ** 2])
    if emission.visibility is not None:
        gaussians = replace(gaussians, opacities=gaussians.opacities * emission.visibility)
    emitted, opacities = gaussians, gaussians.opacities
    if emission.is_culled:
        is_drawn = (opacities >= ALPHA_MIN) & gaussians.means.isfinite().all(dim=-1)
        opacities = opacities * is_drawn
        if emission.merging is None or not config.kind.has_rules:
            emitted = gaussians.keep(is_drawn)
        else:
            emitted = merged(gaussians, is_drawn, grid, of_scene, emission.merging)
    if not config.kind.has_rules:
        return emitted
    for layer in _layers(replace(plain, opacities=opacities), of_scene, grid, emission):
        emitted = append(emitted, layer)
    return emitted


@torch.no_grad()
def _layers(surfaces: Gaussians, cameras: Cameras, grid: tuple[int, int], emission: Emission) -> list[Gaussians]:
    """Return the layers that are emitted, outside all images first."""
    layers = []
    if emission.background is not None:
        layers.append(background_layer(surfaces, cameras, grid, emission.background))
    if emission.is_filled:
        layers.append(occluded_layer(surfaces, cameras, grid))
    return layers


def fade_contradicted(found: Attributes, cameras: Cameras, config: ReceiverConfig) -> Attributes:
    """Return the attributes with lower opacities where other views see through a Gaussian, or have its duplicate."""
    maps = (found.means, found.depth, found.colour, found.opacity)
    opacity = found.opacity * (1.0 - free_space_violation(*maps, cameras, config))
    return replace(found, opacity=opacity * kept_share(*maps, opacity, cameras, config))
