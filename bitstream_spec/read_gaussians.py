"""Second receiver of `.fcs` streams, written from FORMAT.md alone: stream -> Gaussians of section 9.1.

Usage: python read_gaussians.py FILE MODEL OUTPUT [--filled]
MODEL is a folder with the receiver's weights file, `receiver.safetensors`, and a folder `graphs` (section 9.3). OUTPUT
gets rows of float32 values as in vectors/README.md, but of every Gaussian: 11, and 3 for each coefficient. With
--filled, the part of the background layer behind near surfaces follows (section 9.2).
It needs NumPy, onnxruntime, read_stream.py and read_symbols.py. Section numbers in docstrings are those of FORMAT.md.
It shares no code with the product, so that differences between the two reveal errors.
"""

import json
import math
import shutil
import struct
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import read_stream
import read_symbols

FIRST_HARMONIC = 0.28209479177387814
FADED = np.array([1.0, 0.6666667, 0.33333334, 0.0], np.float32)
MOST_FILLED_VIEWS = 8  # section 9.2
POSES = "extrinsics", "intrinsics"
BLOCK = 4096  # points that attend at once
QUARTERS = 0, 3, 2, 1  # ENTROPY.md, section 7.1: step s has the quarter m XOR QUARTERS[s] at a position of phase m
Arrays = dict[str, np.ndarray]
TYPES = {"tensor(float)": np.float32, "tensor(int32)": np.int32, "tensor(bool)": np.bool_}


class Graphs:
    """Section 9.3: the graphs of a model, with its weights beside them."""

    def __init__(self, model: Path, folder: Path) -> None:
        self.folder, self.sessions = folder, dict[str, Any]()
        shutil.copytree(model / "graphs", folder, dirs_exist_ok=True)
        shutil.copy(model / "receiver.safetensors", folder)

    def session(self, name: str) -> Any:
        if name not in self.sessions:
            self.sessions[name] = onnxruntime.InferenceSession(self.folder / f"{name}.onnx")
        return self.sessions[name]

    def shape(self, name: str, of_input: str) -> list[Any]:
        return next(one.shape for one in self.session(name).get_inputs() if one.name == of_input)

    def run(self, name: str, values: dict[str, Any]) -> Arrays:
        """Run a graph on those of the values that it takes. `NAME_after` is returned as NAME."""
        taken: Arrays = {
            one.name: np.asarray(values[one.name], TYPES[one.type], order="C")
            for one in self.session(name).get_inputs()
        }
        names = [one.name.removesuffix("_after") for one in self.session(name).get_outputs()]
        return dict(zip(names, self.session(name).run(None, taken), strict=True))


def read(data: bytes, model: Path, *, is_filled: bool = False) -> np.ndarray:
    """Return a row per Gaussian, in the stored frame. Raises RefusedError for a stream that breaks a rule.

    is_filled: append the part of the background layer that lies behind near surfaces.
    """
    contents, weights = read_stream.read(data), (model / "receiver.safetensors").read_bytes()
    stages, planes = read_stream.decode(contents, weights), read_stream.decode_detail(contents, weights)
    has_rules = receiver_config(weights).get("method") != "paper"
    with tempfile.TemporaryDirectory() as folder:
        graphs = Graphs(model, Path(folder))
        found = attributes(graphs, contents, stages, planes)
        if not has_rules:
            return emitted(contents, visible(contents, found))
        found = visible(contents, rules(graphs, found))
        layer = found["opacities"].shape[0] <= MOST_FILLED_VIEWS and contents.coverage is None
        rows = emitted(contents, found)
        return np.concatenate((rows, occluded(contents, graphs, found))) if is_filled and layer else rows


def receiver_config(weights: bytes) -> dict[str, Any]:
    """ENTROPY.md, section 6.1: what the weights file says about the receiver."""
    (size,) = struct.unpack("<Q", weights[:8])
    config: dict[str, Any] = json.loads(json.loads(weights[8 : 8 + size])["__metadata__"]["config"])
    return config["receiver"]


def normalised(contents: read_stream.Contents) -> Arrays:
    """Section 6.4."""
    centres, views = np.array(contents.centres), len(contents.centres)
    mean = sum(centres[1:], centres[0]) / views
    mantissa, exponent = math.frexp(contents.far / contents.near)
    far = math.ldexp(math.floor(mantissa * 2**11 + 0.5), exponent - 11)
    extrinsics, intrinsics = np.tile(np.eye(4), (views, 1, 1)), np.tile(np.eye(3), (views, 1, 1))
    extrinsics[:, :3, :3] = np.array(contents.rotations).reshape(views, 3, 3)
    extrinsics[:, :3, 3] = np.floor(2**13 * ((centres - mean) / contents.near) + 0.5) / 2**13
    fx, fy, cx, cy = np.array(contents.intrinsics).T
    intrinsics[:, 0, 0], intrinsics[:, 1, 1], intrinsics[:, 0, 2], intrinsics[:, 1, 2] = fx, fy, cx, cy
    return {"extrinsics": extrinsics, "intrinsics": intrinsics, "far": np.array(far), "mean": mean}


def by_step(y_hat: read_symbols.Array) -> Arrays:
    """Section 9.3, step 2: the arrays k_s of ENTROPY.md, section 7.1."""
    y = np.array(y_hat)
    quarter = y.shape[-1] // 4
    phases = [y[:, m >> 1 :: 2, m % 2 :: 2] for m in range(4)]
    return {
        f"step_{s}": np.stack([phases[m][..., quarter * (m ^ x) :][..., :quarter] for m in range(4)])
        for s, x in enumerate(QUARTERS)
    }


def nearest(points: np.ndarray, count: int) -> np.ndarray:
    """Section 9.1: the numbers of the nearest points of each point."""
    points = np.where(np.isfinite(points).all(axis=1)[:, None], points, np.float32(0.0))
    distances = (np.square(points - point).sum(axis=1) for point in points)
    return np.array([np.argsort(distance, kind="stable")[:count] for distance in distances])


def attributes(
    graphs: Graphs, contents: read_stream.Contents, stages: list[read_symbols.Stage], planes: list[list[int]]
) -> Arrays:
    """Section 9.3, steps 2 to 4, and section 9.1 for detail: what is predicted, with the normalised cameras."""
    views, rows, columns = read_stream.size_8(contents.header)
    known: Arrays = normalised(contents)
    known["state"] = np.zeros((views, graphs.shape("update", "state")[1], 2 * rows, 2 * columns))
    for number, stage in enumerate(stages, 1):
        excess = 2 * contents.header["excess"] if number == 1 else 0
        known |= {"lambda_q": np.array(contents.header["lambda_q"] + excess), "stage": np.array(number)}
        known["state"] = graphs.run("update", known | by_step(stage.y_hat))["state"]
    known |= graphs.run("points", known)
    points = known["points"].reshape(-1, 3)
    neighbours = nearest(points, graphs.shape("attend", "neighbours")[1])
    blocks = [np.arange(start, min(start + BLOCK, len(points))) for start in range(0, len(points), BLOCK)]
    runs = [graphs.run("attend", known | {"asking": asking, "neighbours": neighbours[asking]}) for asking in blocks]
    attended = np.concatenate([run["attended"] for run in runs]).reshape(views, rows, columns, -1)
    if any(one.name == "detail" for one in graphs.session("attributes").get_inputs()):
        known["detail"] = np.zeros((views, graphs.shape("attributes", "detail")[1], rows, columns))
        if contents.detail is not None:
            step = np.float32(2.0 ** (-contents.detail[0] / 8))
            symbols = np.array(planes, np.float32).reshape(-1, views, rows, columns)
            known["detail"] = symbols.swapaxes(0, 1) * step
    return known | graphs.run("attributes", known | {"attended": attended})


def rules(graphs: Graphs, found: Arrays) -> Arrays:
    """Section 9.3, step 5: opacities after the rules between views, and harmonics."""
    opacities, views = found["opacities"], len(found["opacities"])
    order = [[*range(i + 1, views), *range(i)] for i in range(views)]
    here = [
        {name: found[name][i] for name in ("positions", "colours", "extrinsics", "intrinsics")} for i in range(views)
    ]
    for i, view in enumerate(here):
        view |= {"confirmed": np.zeros_like(opacities[0]), "violation": np.zeros_like(opacities[0])}
        view |= {"share": np.ones(()), "kept": np.ones_like(opacities[0]), "surface": found["surfaces"][i]}
        view |= {"matrix": np.zeros((3, 3, *opacities[0].shape)), "right": np.zeros((3, 3, *opacities[0].shape))}

    def with_others(name: str) -> None:
        after = []
        for i, view in enumerate(here):
            for j in order[i]:
                there = {f"{key}_there": value for key, value in here[j].items()}
                view = view | graphs.run(name, there | view)
            after.append(view)
        here[:] = after

    if views > 2:
        with_others("confirm")
        for view in here:
            view["share"] = view["confirmed"].mean(dtype=np.float64)
    with_others("free_space")
    for view, before in zip(here, opacities, strict=True):
        view["opacities"] = before * (1.0 - view["violation"])
    if views > 2:
        with_others("duplicates")
    with_others("slope")
    equations = {name: np.stack([view[name] for view in here]) for name in ("matrix", "right")}
    kept = np.stack([view["opacities"] * view["kept"] for view in here])
    return found | {"opacities": kept} | graphs.run("harmonics", found | equations)


def visible(contents: read_stream.Contents, found: Arrays) -> Arrays:
    """Section 9.1, steps 1 to 3: faded opacities, and which Gaussians are kept, `is_kept`."""
    views, rows, columns = read_stream.size_8(contents.header)
    opacities = found["opacities"]
    per_cell = opacities.shape[1] // (2 * rows)
    if contents.fading is not None:
        bits = np.unpackbits(np.frombuffer(contents.fading, np.uint8)).reshape(-1, 2)
        levels = (2 * bits[:, 0] + bits[:, 1]).reshape(views, rows // 2, columns // 2)
        opacities = opacities * FADED[levels].repeat(4 * per_cell, axis=1).repeat(4 * per_cell, axis=2)
    is_kept = (opacities >= np.float32(1 / 255)) & np.isfinite(found["positions"]).all(axis=1)
    if contents.coverage is not None:
        cells = np.unpackbits(np.frombuffer(contents.coverage, np.uint8)).reshape(views, 2 * rows, 2 * columns)
        is_kept &= cells.repeat(per_cell, axis=1).repeat(per_cell, axis=2) == 1
    return found | {"opacities": opacities, "is_kept": is_kept}


def emitted(contents: read_stream.Contents, found: Arrays) -> np.ndarray:
    """Section 9.1, step 4: the rows of the Gaussians that are kept."""
    if "harmonics" in found:
        harmonics = found["harmonics"]
    else:
        constant = (found["colours"].transpose(0, 2, 3, 1).reshape(-1, 1, 3) - np.float32(0.5)) / FIRST_HARMONIC
        harmonics = np.concatenate((constant, found["higher"]), axis=1) if "higher" in found else constant
    means = found["positions"].transpose(0, 2, 3, 1).reshape(-1, 3)
    fields = means, found["scales"], found["rotations"], found["opacities"], harmonics
    return stored(contents, found, fields)[found["is_kept"].ravel()]


def stored(contents: read_stream.Contents, found: Arrays, fields: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return rows in the stored frame (section 6.4). fields: in the normalised frame."""
    means, scales, rotations, opacities, harmonics = fields
    shape = contents.near * means + found["mean"], contents.near * scales, rotations, opacities.reshape(-1, 1)
    return np.concatenate((*shape, harmonics.reshape(len(harmonics), -1)), axis=1).astype("<f4")


def occluded(contents: read_stream.Contents, graphs: Graphs, found: Arrays) -> np.ndarray:
    """Section 9.2: the rows of the background layer behind near surfaces."""
    layer = graphs.run("occluded", found | {"opacities": found["opacities"] * found["is_kept"]})
    known = {name: layer[name] for name in ("means", "surface")} | {name: found[name] for name in POSES}
    known["hidden"] = layer["candidate_opacities"] > 0
    for view in range(len(found["extrinsics"])):
        known |= graphs.run("behind", known | {"view": np.array(view)})
    of_blur = known["hidden"].reshape(2, -1)
    is_used = np.stack((of_blur[0], of_blur[1] & ~of_blur[0])).ravel()
    harmonics = np.zeros((len(is_used), *found["harmonics"].shape[1:]), np.float32)
    harmonics[:, :1] = layer["candidate_colours"]
    fields = layer["means"], layer["scales"], layer["rotations"], layer["candidate_opacities"], harmonics
    return stored(contents, found, fields)[is_used]


def main(arguments: list[str]) -> int:
    is_filled = arguments[4:] == ["--filled"]
    if len(arguments) != 4 + is_filled:
        print("usage: python read_gaussians.py FILE MODEL OUTPUT [--filled]", file=sys.stderr)
        return 1
    try:
        rows = read(Path(arguments[1]).read_bytes(), Path(arguments[2]), is_filled=is_filled)
        Path(arguments[3]).write_bytes(rows.tobytes())
    except read_stream.RefusedError as error:
        print(f"{arguments[1]}: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{error.filename}: cannot be opened ({error.strerror}); check the path.", file=sys.stderr)
        return 1
    print(f"{len(rows)} Gaussians")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
