"""Decode the latents of one stage with the graphs of the entropy model (ENTROPY.md, section 7)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int32, UInt8

from fecocodec.entropy.digest import symbol_digest
from fecocodec.entropy.symbol_coders import SymbolReader
from fecocodec.runtime.graphs import Graphs
from fecocodec.runtime.view_groups import run_by_views

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


class _Batches:
    """Reads batches of symbols and dequantises them."""

    def __init__(self, payload: bytes) -> None:
        self.reader = SymbolReader(payload)
        self.symbols: list[np.ndarray] = []

    def read(self, mean: Int32[np.ndarray, "*shape"], table: UInt8[np.ndarray, "*shape"]) -> np.ndarray:
        """Return the values 256 symbol + mean of the next batch."""
        self.symbols.append(self.reader.exchange(table, None))
        return self.symbols[-1] * np.int32(ONE_Q8) + mean


class _ByViews:
    """Runs graphs of the entropy model on a few views at a time; views are the second axis of their outputs."""

    def __init__(self, graphs: Graphs, size_32: tuple[int, int, int]) -> None:
        self._graphs = graphs
        self._grid = (size_32[0], 8 * size_32[1], 8 * size_32[2])  # the 1/4 grid

    def run(self, name: str, inputs_of: Callable[[slice], dict[str, Any]]) -> list[np.ndarray]:
        return run_by_views(self._graphs, name, self._grid, inputs_of, axis=1)

    def run_on(self, name: str, values: dict[str, np.ndarray]) -> list[np.ndarray]:
        """Run a graph on arrays whose second axis is the view."""
        return self.run(name, lambda group: {key: of_views[:, group] for key, of_views in values.items()})


def decode_stage(
    graphs: Graphs, payload: bytes, size_32: tuple[int, int, int], lambda_q: int, stage: int, context: Steps | None
) -> StageLatents:
    """Decode the latents of stage 1 or 2.

    size_32: views, rows and columns of z. lambda_q: of the stage. context: steps of stage 1 when decoding stage 2, else
    None. Raises BitstreamError for a payload that is not valid. A damaged payload can decode without an error, so the
    caller must compare `digest()` with the stored digest.
    """
    batches = _Batches(payload)
    mean, table = graphs.run("hyper", lambda_q=lambda_q, stage=stage)
    z_hat = batches.read(*(np.ascontiguousarray(np.broadcast_to(x, (*size_32, x.size))) for x in (mean, table)))
    around = {} if context is None else {f"context_{number}": step for number, step in enumerate(context)}
    by_views = _ByViews(graphs, size_32)

    def inputs_of(group: slice) -> dict[str, Any]:
        return {"lambda_q": lambda_q, "z_hat": z_hat[group]} | {key: step[:, group] for key, step in around.items()}

    features, *parameters = by_views.run(f"features_{stage}", inputs_of)
    steps = _decode_y(by_views, batches, features, parameters)
    batches.reader.finish()
    return StageLatents(tuple(batches.symbols), z_hat, steps)


def _decode_y(
    by_views: _ByViews, batches: _Batches, features: Float[np.ndarray, "..."], parameters: list[np.ndarray]
) -> Steps:
    """Decode the three passes of step 0, then steps 1 to 3. parameters: of the first pass."""
    passes = {"features": features, "pass_0": batches.read(*parameters)}
    for number in (1, 2):
        parameters = by_views.run_on(f"pass_{number}", passes)
        passes[f"pass_{number}"] = batches.read(*parameters)
    first, *parameters = by_views.run_on("step_1", passes)
    steps = {"features": features, "step_0": first, "step_1": batches.read(*parameters)}
    for number in (2, 3):
        parameters = by_views.run_on(f"step_{number}", steps)
        steps[f"step_{number}"] = batches.read(*parameters)
    return tuple(steps[f"step_{number}"] for number in range(4))
