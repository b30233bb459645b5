"""Names, modules and inputs of the graphs of the networks in floating point, and of the steps over pairs of views."""

import torch

from fecocodec.config import ReceiverConfig
from fecocodec.receiver.model import Receiver
from fecocodec.splatting.background import DEFAULT_BACKGROUND, background_candidates, cell_centres
from fecocodec.splatting.occluded import occluded_candidates
from fecocodec.training.graphs import pairs, prediction
from fecocodec.training.graphs.pairs import BehindGraph, CandidatesGraph, HideGraph
from fecocodec.training.graphs.prediction import UpdateGraph
from fecocodec.training.graphs.specification import Graph, GraphInput, graph_of


def _floats(shape: str) -> GraphInput:
    return GraphInput(shape, torch.float32)


_SCALAR = GraphInput("", torch.int32)
_CAMERAS = {"extrinsics": _floats("views 4 4"), "intrinsics": _floats("views 3 3"), "far": _floats("")}
_GRID = "16*rows 16*columns"  # of the Gaussians
_MAPS = {"positions": _floats(f"views 3 {_GRID}"), "colours": _floats(f"views 3 {_GRID}")}
_EQUATIONS = {name: _floats(f"views 3 3 {_GRID}") for name in ("matrix", "right")}
_OWN = {
    "positions": _floats(f"3 {_GRID}"),
    "colours": _floats(f"3 {_GRID}"),
    "extrinsics": _floats("4 4"),
    "intrinsics": _floats("3 3"),
}
_PAIR_INPUTS = _OWN | {f"{name}_there": of for name, of in _OWN.items()}
_PAIR_INPUTS |= {
    name: _floats(_GRID) for name in ("confirmed", "violation", "kept", "confirmed_there", "opacities_there")
}
_PAIR_INPUTS |= {name: _floats(f"3 3 {_GRID}") for name in ("matrix", "right")}
_PAIR_INPUTS |= {"surface_there": _floats("4 8*rows 8*columns"), "share": _floats(""), "share_there": _floats("")}


def network_graphs(receiver: Receiver) -> dict[str, Graph]:
    """Return the graphs by name, `model_files.ReceiverKind.graph_names` without those of the entropy model."""
    of_views = _state_graphs(receiver) | _attribute_graphs(receiver)
    if not receiver.config.kind.has_rules:
        return of_views
    harmonics = graph_of(prediction.HarmonicsGraph(receiver.config), _MAPS | _CAMERAS | _EQUATIONS, "harmonics")
    return of_views | _pair_graphs(receiver.config) | {"harmonics": harmonics} | _background_graphs()


def _state_graphs(receiver: Receiver) -> dict[str, Graph]:
    config = receiver.config
    step = GraphInput(f"4 views 2*rows 2*columns {config.latent_channels // 4}", torch.int32)
    known = _CAMERAS | {"state": _features(receiver), "lambda_q": _SCALAR, "stage": _SCALAR}
    known |= {f"step_{number}": step for number in range(4)}
    searched = ("points", "depth", "keys_values", "queries")
    return {
        "update": graph_of(UpdateGraph(receiver), known, "state_after"),
        "points": graph_of(prediction.PointsGraph(receiver), known, "features", "relative", *searched),
    }


def _attribute_graphs(receiver: Receiver) -> dict[str, Graph]:
    config, grid = receiver.config, "4*rows 4*columns"
    known = _CAMERAS | {
        "asking": GraphInput("block", torch.int32),
        "neighbours": GraphInput(f"block {config.num_neighbours + 1}", torch.int32),
        "points": _floats(f"views {grid} 3"),
        "depth": _floats(f"views {grid}"),
        "keys_values": _floats(f"views {grid} {2 * config.attention_channels}"),
        "queries": _floats(f"views {grid} {config.attention_channels}"),
        "features": _features(receiver),
        "attended": _floats(f"views {grid} {config.state_channels}"),
        "relative": _floats("views 8*rows 8*columns"),
    }
    if config.detail_planes:
        known["detail"] = _floats(f"views {config.detail_planes} 4*rows 4*columns")
    outputs = ["positions", "scales", "rotations", "opacities", "colours"]
    outputs += ["surfaces"] if config.kind.has_rules else ["higher"] if config.sh_degree else []
    return {
        "attend": graph_of(prediction.AttendGraph(receiver), known, "attended"),
        "attributes": graph_of(prediction.AttributesGraph(receiver), known, *outputs),
    }


def _pair_graphs(config: ReceiverConfig) -> dict[str, Graph]:
    return {
        "confirm": graph_of(pairs.ConfirmGraph(config), _PAIR_INPUTS, "confirmed_after", "violation_after"),
        "free_space": graph_of(pairs.FreeSpaceGraph(config), _PAIR_INPUTS, "violation_after"),
        "duplicates": graph_of(pairs.DuplicatesGraph(config), _PAIR_INPUTS, "kept_after"),
        "slope": graph_of(pairs.SlopeGraph(config), _PAIR_INPUTS, "matrix_after", "right_after"),
    }


def _background_graphs() -> dict[str, Graph]:
    cells = len(cell_centres(DEFAULT_BACKGROUND, torch.zeros(1)))
    fields = {"means": _floats("candidates 3"), "scales": _floats("candidates 3"), "rotations": _floats("candidates 4")}
    known = (
        _MAPS
        | _CAMERAS
        | fields
        | {
            "opacities": _floats(f"views {_GRID}"),
            "view": _SCALAR,
            "extended": _floats(f"views {cells} {cells}"),
            "surface": _floats("views 4*rows 4*columns"),
            "hidden": GraphInput("candidates", torch.bool),
        }
    )
    candidates = (*fields, "candidate_opacities", "candidate_colours")
    return {
        "background": graph_of(CandidatesGraph(background_candidates), known, *candidates, "extended"),
        "hide": graph_of(HideGraph(), known, "hidden_after"),
        "occluded": graph_of(CandidatesGraph(occluded_candidates), known, *candidates, "surface"),
        "behind": graph_of(BehindGraph(), known, "hidden_after"),
    }


def _features(receiver: Receiver) -> GraphInput:
    return _floats(f"views {receiver.config.state_channels} 8*rows 8*columns")
