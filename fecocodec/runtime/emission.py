"""Emit Gaussians: predict them from the last state, cull, merge, add the background layer, transform to the world."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32

from fecocodec.geometry.gaussian_arrays import ALPHA_MIN, GaussianArrays, SceneCameras
from fecocodec.geometry.scene_frame import normalise
from fecocodec.merging.grouping import MergingConfig
from fecocodec.merging.merge import merged_fields
from fecocodec.runtime.graphs import Graphs
from fecocodec.runtime.prediction import LastState, Prediction, fitted_harmonics, poses_of, predict


@dataclass(frozen=True)
class EmissionConfig:
    """Options of the emitted Gaussians: largest degree of the harmonics, background layer, merging (None: none).

    The paper's method has no background layer and no merging, whatever the options say.
    """

    sh_degree: int
    has_background: bool
    merging: MergingConfig | None


def emit(
    graphs: Graphs,
    last: LastState,
    cameras: SceneCameras,
    visibility: Float32[np.ndarray, " n"] | None,
    config: EmissionConfig,
    is_filled: bool,
) -> GaussianArrays:
    """Return the Gaussians of a state in the world frame and unit of length of `cameras`.

    cameras: of the context views, as stored in the stream. visibility: factors in [0, 1] of the opacities of the
    Gaussians of the grids, ordered (view, row, column); None for 1. The background layer comes last.
    is_filled: whether the background layer has a part behind near surfaces, see `is_filled_behind`.
    """
    normalised, frame = normalise(cameras)
    has_rules = graphs.kind.method.has_rules
    prediction = predict(graphs, last, normalised)
    if visibility is not None:
        visible = prediction.opacities * visibility.reshape(prediction.opacities.shape)
        prediction = replace(prediction, opacities=visible)
    gaussians = plain = prediction.gaussians()
    if has_rules and config.sh_degree and cameras.num_views > 1:
        gaussians = replace(plain, harmonics=fitted_harmonics(graphs, prediction, normalised))
    gaussians = replace(gaussians, harmonics=gaussians.harmonics[:, : (config.sh_degree + 1) ** 2])
    is_emitted = (plain.opacities >= ALPHA_MIN) & np.isfinite(plain.means).all(axis=1)
    if config.merging is None or not has_rules:
        emitted = gaussians.keep(is_emitted)
    else:
        poses = (normalised.extrinsics, normalised.intrinsics)
        emitted = GaussianArrays(
            *merged_fields(gaussians.fields(), is_emitted, prediction.grid, *poses, config.merging)
        )
    if has_rules and config.has_background:
        opacities = prediction.opacities * is_emitted.reshape(prediction.opacities.shape)
        for part in (_outside, _occluded) if is_filled else (_outside,):
            emitted = _append(emitted, part(graphs, replace(prediction, opacities=opacities), normalised))
    return frame.to_world(emitted)


def _outside(graphs: Graphs, emitted: Prediction, cameras: SceneCameras) -> GaussianArrays:
    """Return the layer outside all images, of degree 0. emitted: with an opacity of 0 where nothing is emitted."""
    poses = poses_of(cameras)
    *fields, extended = graphs.run("background", **emitted.maps(), opacities=emitted.opacities, **poses)
    candidates = GaussianArrays(*fields)
    shapes = {"means": candidates.means, "scales": candidates.scales, "rotations": candidates.rotations}
    hidden = candidates.opacities > 0
    for view in range(cameras.num_views):
        (hidden,) = graphs.run("hide", view=view, **shapes, extended=extended, **poses, hidden=hidden)
    return candidates.keep(hidden)


def _occluded(graphs: Graphs, emitted: Prediction, cameras: SceneCameras) -> GaussianArrays:
    """Return the background layer behind near surfaces, with harmonics of degree 0. emitted: as for `_outside`."""
    poses = poses_of(cameras)
    *fields, surface = graphs.run("occluded", **emitted.maps(), opacities=emitted.opacities, **poses)
    candidates = GaussianArrays(*fields)
    hidden = candidates.opacities > 0
    for view in range(cameras.num_views):
        (hidden,) = graphs.run("behind", view=view, means=candidates.means, surface=surface, **poses, hidden=hidden)
    of_blur = hidden.reshape(-1, surface.size)
    return candidates.keep((of_blur & (of_blur.cumsum(axis=0) == 1)).ravel())


def _append(gaussians: GaussianArrays, layer: GaussianArrays) -> GaussianArrays:
    """Concatenate Gaussians and a layer of degree 0, whose higher harmonics are set to zero."""
    harmonics = np.zeros((layer.count, *gaussians.harmonics.shape[1:]), np.float32)
    harmonics[:, :1] = layer.harmonics
    added = replace(layer, harmonics=harmonics)
    return GaussianArrays(*map(np.concatenate, zip(gaussians.fields(), added.fields(), strict=True)))
