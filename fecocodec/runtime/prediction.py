"""Predict Gaussians from a state: networks, with the neighbour search and loops over pairs of views between them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32, Int32

from fecocodec.geometry.gaussian_arrays import SH_DEGREE_0, GaussianArrays, SceneCameras
from fecocodec.runtime.graphs import Arrays, Graphs, run_by_views, run_over_others, run_over_pairs
from fecocodec.runtime.neighbours import nearest_neighbours

POINTS_AT_ONCE = 4096  # points per block of attention, so that gathered keys and values take little memory


@dataclass(frozen=True)
class LastState:
    """State after the last decoded stage, with the lambda and the number of this stage, and the detail of the stream.

    detail: symbols times their step; None for none.
    """

    state: Float32[np.ndarray, "view channel h4 w4"]
    lambda_q: int
    stage: int
    detail: Float32[np.ndarray, "view plane h8 w8"] | None = None


@dataclass(frozen=True)
class Prediction:
    """Predicted Gaussians in the normalised frame, on grids of their views, usually the 1/2 grids.

    colours: sRGB, of degree 0. higher: coefficients of the harmonics above degree 0.
    """

    positions: Float32[np.ndarray, "view 3 h2 w2"]
    colours: Float32[np.ndarray, "view 3 h2 w2"]
    opacities: Float32[np.ndarray, "view h2 w2"]
    scales: Float32[np.ndarray, "n 3"]
    rotations: Float32[np.ndarray, "n 4"]
    higher: Float32[np.ndarray, "n rest 3"]

    @property
    def grid(self) -> tuple[int, int]:
        return self.opacities.shape[1], self.opacities.shape[2]

    def maps(self) -> Arrays:
        """Return the inputs that the steps over other views have in common."""
        return {"positions": self.positions, "colours": self.colours}

    def gaussians(self) -> GaussianArrays:
        """Return the Gaussians, ordered (view, row, column), with the predicted harmonics."""
        means, colours = (np.moveaxis(x, 1, 3).reshape(-1, 3) for x in (self.positions, self.colours))
        harmonics = (colours[:, None] - np.float32(0.5)) / np.float32(SH_DEGREE_0)
        harmonics = np.concatenate((harmonics, self.higher), axis=1)
        return GaussianArrays(means, self.scales, self.rotations, self.opacities.reshape(-1), harmonics)


def predict(graphs: Graphs, last: LastState, cameras: SceneCameras) -> Prediction:
    """Return the Gaussians of a state. cameras: normalised."""
    positions, scales, rotations, opacities, colours, *others = _attributes(graphs, last, cameras)
    higher = np.zeros((len(scales), 0, 3), np.float32)
    if graphs.kind.method.has_rules:
        of_views = {"positions": positions, "colours": colours, "surface": others[0]} | poses_of(cameras)
        opacities = opacities * (1 - _free_space_violation(graphs, of_views))
        opacities = np.minimum(opacities, np.float32(1))  # the sigmoid of onnxruntime can be 1 + 2^-23
        opacities = opacities * _kept_share(graphs, of_views, opacities)
    elif others:
        higher = others[0]
    return Prediction(positions, colours, np.minimum(opacities, np.float32(1)), scales, rotations, higher)


def _attributes(graphs: Graphs, last: LastState, cameras: SceneCameras) -> list[np.ndarray]:
    """Return the outputs of the graph `attributes`: attributes before the free-space check, and surfaces of views.

    Models of a method without rules have no surfaces, but may have harmonics above degree 0.
    """
    poses, far = poses_of(cameras), {"far": np.asarray(cameras.far, np.float32)}
    rate: dict[str, Any] = {"lambda_q": last.lambda_q, "stage": last.stage}
    views, _, height, width = last.state.shape

    def run(name: str, shared: dict[str, Any], **maps: np.ndarray) -> list[np.ndarray]:
        def inputs_of(group: slice) -> dict[str, Any]:
            return {key: values[group] for key, values in (maps | poses).items()} | far | shared

        return run_by_views(graphs, name, (views, height, width), inputs_of)

    features, relative, points, depth, keys_values, queries = run("points", rate, state=last.state)
    of_points = {"points": points, "depth": depth, "keys_values": keys_values, "queries": queries}
    attended = _attend(graphs, of_points, poses["extrinsics"])
    maps = {"features": features, "attended": attended, "relative": relative}
    if "detail" in graphs.input_names("attributes"):
        planes = int(graphs.input_shape("attributes", "detail")[1])
        none = np.zeros((views, planes, height // 2, width // 2), np.float32)
        maps["detail"] = none if last.detail is None else last.detail
    return run("attributes", {}, **maps)


def poses_of(cameras: SceneCameras) -> Arrays:
    return {"extrinsics": cameras.extrinsics, "intrinsics": cameras.intrinsics}


def fitted_harmonics(graphs: Graphs, prediction: Prediction, cameras: SceneCameras) -> Float32[np.ndarray, "n 4 3"]:
    """Return harmonics of degree 1, fitted to the colours of other views. cameras: normalised, two or more."""
    of_views = prediction.maps() | poses_of(cameras)
    start = dict.fromkeys(("matrix", "right"), np.zeros((3, 3, *prediction.grid), np.float32))

    def fitted(graphs: Graphs, view: int) -> np.ndarray:
        inputs = {key: of_views[key][view] for key in ("positions", "colours", "extrinsics")}
        inputs |= run_over_others(graphs, "slope", view, of_views, start)
        return graphs.run("harmonics", **{key: values[None] for key, values in inputs.items()})[0]

    return np.concatenate(graphs.map(fitted, range(cameras.num_views)))


def _attend(
    graphs: Graphs, of_points: Arrays, extrinsics: Float32[np.ndarray, "view 4 4"]
) -> Float32[np.ndarray, "view h8 w8 channel"]:
    """Return the residual of attention of each point to its neighbours, computed in blocks of points."""
    num_neighbours = int(graphs.input_shape("attend", "neighbours")[-1])
    neighbours = nearest_neighbours(of_points["points"].reshape(-1, 3), num_neighbours, graphs.num_threads)
    asking: Int32[np.ndarray, " n"] = np.arange(len(neighbours), dtype=np.int32)
    blocks = [slice(first, first + POINTS_AT_ONCE) for first in range(0, len(asking), POINTS_AT_ONCE)]

    def attended(graphs: Graphs, block: slice) -> np.ndarray:
        inputs = {"asking": asking[block], "neighbours": neighbours[block], **of_points, "extrinsics": extrinsics}
        return graphs.run("attend", **inputs)[0]

    return np.concatenate(graphs.map(attended, blocks)).reshape(*of_points["depth"].shape, -1)


def _free_space_violation(graphs: Graphs, of_views: Arrays) -> Float32[np.ndarray, "view h2 w2"]:
    """Return the strongest free-space violation of each Gaussian. of_views: positions, colours, surface and poses."""
    views, _, *grid = of_views["positions"].shape
    confirmed = violation = np.zeros((views, *grid), np.float32)
    share = np.ones(views, np.float32)
    if views > 2:
        confirmed, violation = run_over_pairs(
            graphs, "confirm", of_views, {"confirmed": confirmed, "violation": violation}
        )
        share = confirmed.mean(axis=(1, 2))
    judged = of_views | {"confirmed": confirmed, "share": share}
    return run_over_pairs(graphs, "free_space", judged, {"violation": violation})[0]


def _kept_share(
    graphs: Graphs, of_views: Arrays, opacities: Float32[np.ndarray, "view h2 w2"]
) -> Float32[np.ndarray, "view h2 w2"]:
    """Return the share of its opacity that each Gaussian keeps beside finer ones.

    of_views: positions, surface and poses. opacities: after the free-space check.
    """
    kept = np.ones_like(opacities)
    if len(kept) < 3:
        return kept
    return run_over_pairs(graphs, "duplicates", of_views | {"opacities": opacities}, {"kept": kept})[0]
