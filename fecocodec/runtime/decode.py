"""Decode the stages of a `.fcs` stream to Gaussians without torch."""

from dataclasses import replace

import numpy as np

from fecocodec.coding.detail import detail_values
from fecocodec.coding.visibility import is_filled_behind, visibility_of
from fecocodec.container import (
    Detail,
    Header,
    IntactPart,
    Stages,
    Stream,
    check_symbol_digest,
)
from fecocodec.errors import BitstreamError
from fecocodec.limits import SIDE_MULTIPLE
from fecocodec.progress import OnProgress
from fecocodec.runtime.emission import EmissionConfig, emit
from fecocodec.runtime.graphs import Graphs
from fecocodec.runtime.latents import Steps, decode_stage
from fecocodec.runtime.prediction import LastState
from fecocodec.runtime.scene import Decoded, unpack
from fecocodec.runtime.view_groups import run_by_views


def decode(
    graphs: Graphs, part: IntactPart, stages: Stages, config: EmissionConfig, on_progress: OnProgress
) -> Decoded:
    """Decode the part of a stream that `read_stages` has read for `stages`; on_progress as for `decoding.decode`.

    Raises BitstreamError for a stream that breaks a rule of the format, ModelError if a graph is missing or was
    exported from other weights.
    """
    stream, header = part.stream, part.stream.header
    last, damage = _decode_stages(graphs, stream, stages, on_progress)
    if stream.detail is not None and last.stage == header.num_stages:
        last, damage = _with_detail(graphs, header, stream.detail, last, stages)
    on_progress("predicting Gaussians", 0.8)
    cameras = unpack(stream.cameras)
    is_filled = is_filled_behind(header.num_views, stream.coverage is not None)
    gaussians = emit(graphs, last, cameras, visibility_of(stream), config, is_filled)
    return Decoded(gaussians, cameras, (header.height, header.width), last.stage, part.damage or damage)


def _decode_stages(
    graphs: Graphs, stream: Stream, stages: Stages, on_progress: OnProgress
) -> tuple[LastState, str | None]:
    """Return the last state, and the message about damage that "intact" tolerates."""
    header = stream.header
    last: LastState | None = None
    context: Steps | None = None
    for stage, payload in enumerate(stream.payloads, start=1):
        on_progress(f"decoding stage {stage}", 0.4 * (stage - 1))
        try:
            context = _decode_symbols(graphs, header, payload, stage, context)
        except BitstreamError as error:
            if last is None or stages != "intact":
                raise
            return last, str(error)
        last = _advance(graphs, header, context, last, stage)
    assert last is not None  # a stream has at least one stage
    return last, None


def _with_detail(
    graphs: Graphs, header: Header, detail: Detail, last: LastState, stages: Stages
) -> tuple[LastState, str | None]:
    """Return the state with the numbers of the detail layer, and the message about damage that "intact" tolerates."""
    tables = graphs.bytes_tensor("detail.tables")
    try:
        return replace(last, detail=detail_values(tables, detail, header)), None
    except BitstreamError as error:
        if stages != "intact":
            raise
        return last, str(error)


def _decode_symbols(graphs: Graphs, header: Header, payload: bytes, stage: int, context: Steps | None) -> Steps:
    """Return the values of y. Raises BitstreamError if the payload is not valid or its digest differs."""
    height, width = header.grid_size
    size = (header.num_views, height // SIDE_MULTIPLE, width // SIDE_MULTIPLE)
    coded = decode_stage(graphs, payload, size, header.lambda_q_of_stage(stage), stage, context)
    check_symbol_digest(header, stage, coded.digest())
    return coded.steps


def _advance(graphs: Graphs, header: Header, steps: Steps, before: LastState | None, stage: int) -> LastState:
    """Return the state after a stage. The state before stage 1 has any values."""
    if before is None:
        channels = int(graphs.input_shape("update", "state")[1])
        height, width = (side // 4 for side in header.grid_size)
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
