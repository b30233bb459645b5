"""Emit Gaussians: predict them from the last state, cull, merge, add the background layer, transform to the world."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32

from fecocodec.container import Header
from fecocodec.container.coverage import CELL, coverage_grid
from fecocodec.merging.merge import MergingConfig, merged_fields
from fecocodec.runtime.graphs import Graphs
from fecocodec.runtime.neighbours import nearest_neighbours
from fecocodec.runtime.scene import SceneCameras, SceneGaussians, normalise

LEAST_OPACITY = 1.0 / 255.0  # renderers skip fainter Gaussians
GAUSSIANS_PER_SIDE = CELL // 2  # of a cell; there is one Gaussian per 2x2 pixels


@dataclass(frozen=True)
class EmissionConfig:
    """Options of the emitted Gaussians: degree of the harmonics (0 or 1), background layer, merging (None: none)."""

    sh_degree: int
    has_background: bool
    merging: MergingConfig | None


@dataclass(frozen=True)
class LastState:
    """State after the last decoded stage, with the lambda and the number of this stage."""

    state: Float32[np.ndarray, "view channel h4 w4"]
    lambda_q: int
    stage: int


def emit(
    graphs: Graphs,
    last: LastState,
    cameras: SceneCameras,
    is_covered: Bool[np.ndarray, " n"] | None,
    config: EmissionConfig,
) -> SceneGaussians:
    """Return the Gaussians of a state in the world frame and unit of length of `cameras`.

    cameras: of the context views, as stored in the stream. is_covered: mask of the Gaussians of the 1/2 grids, ordered
    (view, row, column); Gaussians with False are dropped. None drops none. The background layer comes last.
    """
    normalised, frame = normalise(cameras)
    plain, harmonics = _predict(graphs, last, normalised)
    has_slope = config.sh_degree == 1 and cameras.num_views > 1
    gaussians = replace(plain, harmonics=harmonics) if has_slope else plain
    is_emitted = (plain.opacities >= LEAST_OPACITY) & np.isfinite(plain.means).all(axis=1)
    if is_covered is not None:
        is_emitted &= is_covered
    grid = (4 * last.state.shape[2] // 2, 4 * last.state.shape[3] // 2)
    if config.merging is None:
        emitted = gaussians.keep(is_emitted)
    else:
        poses = (normalised.extrinsics, normalised.intrinsics)
        emitted = SceneGaussians(*merged_fields(gaussians.fields(), is_emitted, grid, *poses, config.merging))
    if config.has_background:
        emitted = _append(emitted, _background(graphs, plain, is_emitted, grid, normalised))
    return frame.to_world(emitted)


def is_in_covered_cell(bits: bytes, header: Header) -> Bool[np.ndarray, " n"]:
    """Return which Gaussians of the 1/2 grids, ordered (view, row, column), belong to a covered cell."""
    cells = np.unpackbits(np.frombuffer(bits, dtype=np.uint8)).astype(bool).reshape(coverage_grid(header))
    return cells.repeat(GAUSSIANS_PER_SIDE, axis=1).repeat(GAUSSIANS_PER_SIDE, axis=2).reshape(-1)


def _predict(
    graphs: Graphs, last: LastState, cameras: SceneCameras
) -> tuple[SceneGaussians, Float32[np.ndarray, "n 4 3"]]:
    """Return the Gaussians with harmonics of degree 0, and the harmonics of degree 1. cameras: normalised."""
    poses = {
        "extrinsics": cameras.extrinsics,
        "intrinsics": cameras.intrinsics,
        "far": np.float32(cameras.far),
    }
    features, relative, points, depth = graphs.run(
        "points", state=last.state, lambda_q=last.lambda_q, stage=last.stage, **poses
    )
    num_neighbours = int(graphs.input_shape("predict", "neighbours")[-1])
    neighbours = nearest_neighbours(points.reshape(-1, 3), num_neighbours).reshape(*depth.shape, num_neighbours)
    searched = {"relative": relative, "points": points, "depth": depth, "neighbours": neighbours}
    *fields, harmonics = graphs.run("predict", features=features, **searched, **poses)
    return SceneGaussians(*fields), harmonics


def _background(
    graphs: Graphs,
    plain: SceneGaussians,
    is_emitted: Bool[np.ndarray, " n"],
    grid: tuple[int, int],
    cameras: SceneCameras,
) -> SceneGaussians:
    """Return the background layer, with harmonics of degree 0."""
    shape = (cameras.num_views, *grid)
    *fields, is_kept = graphs.run(
        "background",
        means=plain.means.reshape(*shape, 3),
        opacities=(plain.opacities * is_emitted).reshape(shape),
        colours=plain.harmonics.reshape(*shape, 3),
        extrinsics=cameras.extrinsics,
        intrinsics=cameras.intrinsics,
    )
    return SceneGaussians(*fields).keep(is_kept)


def _append(gaussians: SceneGaussians, layer: SceneGaussians) -> SceneGaussians:
    """Concatenate Gaussians and a layer of degree 0, whose higher harmonics are set to zero."""
    harmonics = np.zeros((layer.count, *gaussians.harmonics.shape[1:]), np.float32)
    harmonics[:, :1] = layer.harmonics
    added = replace(layer, harmonics=harmonics)
    return SceneGaussians(*map(np.concatenate, zip(gaussians.fields(), added.fields(), strict=True)))
