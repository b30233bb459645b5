"""Decode the stages of a `.fcs` stream to Gaussians without torch."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Int32, UInt8

from fecocodec.coding.detail import detail_values
from fecocodec.coding.visibility import is_filled_behind, visibility_of
from fecocodec.container import Detail, Header, IntactPart, Stages, check_symbol_digest, decode_stages
from fecocodec.entropy.symbol_coders import SymbolReader, symbol_digest
from fecocodec.geometry.gaussian_arrays import SceneCameras
from fecocodec.grid import FEATURES, HYPERLATENTS
from fecocodec.progress import OnProgress
from fecocodec.runtime.emission import EmissionConfig, emit
from fecocodec.runtime.graphs import Arrays, Graphs, bytes_tensor, run_by_views
from fecocodec.runtime.prediction import LastState
from fecocodec.runtime.scene import Decoded

ONE_Q8 = 256

Steps = tuple[Int32[np.ndarray, "4 view h16 w16 quarter"], ...]
"""Decoded values of y, Q8: the four steps of the coding order."""


@dataclass(frozen=True)
class StageLatents:
    """Decoded latents of one stage. symbols: one array per batch. z_hat: Q8."""

    symbols: tuple[Int32[np.ndarray, "..."], ...]
    z_hat: Int32[np.ndarray, "view h32 w32 channel"]
    steps: Steps

    def digest(self) -> bytes:
        """Return the 8-byte digest of the symbols that the header stores."""
        return symbol_digest(self.symbols)


def decode_stage(
    graphs: Graphs, payload: bytes, size_32: tuple[int, int, int], lambda_q: int, stage: int, context: Steps | None
) -> StageLatents:
    """Decode the latents of stage 1 or 2.

    size_32: views, rows and columns of z. lambda_q: of the stage. context: steps of stage 1 when decoding stage 2, else
    None. Raises BitstreamError for a payload that is not valid. A damaged payload can decode without an error, so the
    caller must compare `digest()` with the stored digest.
    """
    reader, symbols = SymbolReader(payload), list[np.ndarray]()

    def read(mean: Int32[np.ndarray, "*shape"], table: UInt8[np.ndarray, "*shape"]) -> np.ndarray:
        """Return the values 256 symbol + mean of the next batch."""
        symbols.append(reader.exchange(table, None))
        return symbols[-1] * np.int32(ONE_Q8) + mean

    mean, table = graphs.run("hyper", lambda_q=lambda_q, stage=stage)
    z_hat = read(*(np.ascontiguousarray(np.broadcast_to(x, (*size_32, x.size))) for x in (mean, table)))
    around = {} if context is None else {f"context_{number}": step for number, step in enumerate(context)}
    cells = HYPERLATENTS // FEATURES
    run = partial(run_by_views, graphs, grid=(size_32[0], cells * size_32[1], cells * size_32[2]), axis=1)

    def run_on(name: str, values: Arrays) -> list[np.ndarray]:
        """Run a graph on arrays whose second axis is the view."""
        return run(name, inputs_of=lambda group: {key: of_views[:, group] for key, of_views in values.items()})

    def inputs_of(group: slice) -> dict[str, Any]:
        return {"lambda_q": lambda_q, "z_hat": z_hat[group]} | {key: step[:, group] for key, step in around.items()}

    features, *parameters = run(f"features_{stage}", inputs_of=inputs_of)
    passes = {"features": features, "pass_0": read(*parameters)}  # of step 0
    for number in (1, 2):
        passes[f"pass_{number}"] = read(*run_on(f"pass_{number}", passes))
    first, *parameters = run_on("step_1", passes)
    steps = {"features": features, "step_0": first, "step_1": read(*parameters)}
    for number in (2, 3):
        steps[f"step_{number}"] = read(*run_on(f"step_{number}", steps))
    reader.finish()
    return StageLatents(tuple(symbols), z_hat, tuple(steps[f"step_{number}"] for number in range(4)))


def decode(
    graphs: Graphs, part: IntactPart, stages: Stages, config: EmissionConfig, on_progress: OnProgress
) -> Decoded:
    """Decode the part of a stream that `read_stages` has read for `stages`; on_progress as for `decoding.decode`.

    Raises BitstreamError for a stream that breaks a rule of the format, ModelError if a graph is missing or was
    exported from other weights.
    """
    stream, header = part.stream, part.stream.header
    height, width = header.grid_size
    size_32 = (header.num_views, height // HYPERLATENTS, width // HYPERLATENTS)

    def advance(stage: int, payload: bytes, before: tuple[LastState, Steps] | None) -> tuple[LastState, Steps]:
        last, context = before or (None, None)
        coded = decode_stage(graphs, payload, size_32, header.lambda_q_of_stage(stage), stage, context)
        check_symbol_digest(header, stage, coded.digest())
        return _advance(graphs, header, coded.steps, last, stage), coded.steps

    def with_detail(detail: Detail, before: tuple[LastState, Steps]) -> tuple[LastState, Steps]:
        values = detail_values(bytes_tensor(graphs.weights, "detail.tables"), detail, header)
        return replace(before[0], detail=values), before[1]

    (last, _), _, damage = decode_stages(stream, stages, advance, with_detail, on_progress)
    on_progress("predicting Gaussians", 0.8)
    packed = stream.cameras
    cameras = SceneCameras.of_rows(packed.extrinsics, packed.intrinsics, packed.near, packed.far)
    is_filled = is_filled_behind(header.num_views, stream.coverage is not None)
    visibility = visibility_of(stream, graphs.kind.gaussians_per_side)
    gaussians = emit(graphs, last, cameras, visibility, config, is_filled)
    return Decoded(gaussians, cameras, (header.height, header.width), last.stage, part.damage or damage)


def _advance(graphs: Graphs, header: Header, steps: Steps, before: LastState | None, stage: int) -> LastState:
    """Return the state after a stage. The state before stage 1 has any values."""
    if before is None:
        channels = int(graphs.input_shape("update", "state")[1])
        height, width = (side // FEATURES for side in header.grid_size)
        state = np.zeros((header.num_views, channels, height, width), np.float32)
    else:
        state = before.state
    lambda_q = header.lambda_q_of_stage(stage)

    def inputs_of(group: slice) -> dict[str, np.ndarray | int]:
        values = {f"step_{number}": step[:, group] for number, step in enumerate(steps)}
        return {"state": state[group], "lambda_q": lambda_q, "stage": stage, **values}

    views, _, height, width = state.shape
    (after,) = run_by_views(graphs, "update", (views, height, width), inputs_of)
    return LastState(after, lambda_q, stage)
