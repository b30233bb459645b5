"""Loops with a variable number of iterations, in a form that an exported graph can contain.

When a network runs, these are Python loops. When it is exported, they become loops of the graph.
"""

from collections.abc import Callable

import torch
from torch import Tensor

EXPORTED_BLOCKS = 16  # the number of points of a scene is a multiple of this

Carried = tuple[Tensor, ...]


def fold(step: Callable[..., Carried], first: int, end: int | Tensor, carried: Carried) -> Carried:
    """Return `carried` after `carried = step(index, *carried)` for every index in [first, end).

    step: returns new tensors of the same shapes and dtypes. index is an int, or an int64 scalar in an export.
    """
    if torch.compiler.is_exporting():
        from torch._higher_order_ops import while_loop

        def is_left(index: Tensor, *_: Tensor) -> Tensor:
            return index < end

        def body(index: Tensor, *before: Tensor) -> Carried:
            return index + 1, *step(index, *before)

        looped: Carried = while_loop(is_left, body, (torch.tensor(first), *carried))
        return looped[1:]
    for index in range(first, int(end)):
        carried = step(index, *carried)
    return carried


def in_blocks(function: Callable[..., Tensor], at_once: int, *rows: Tensor) -> Tensor:
    """Return function(*rows), computed for blocks of rows and concatenated.

    at_once: number of rows per block. An export has EXPORTED_BLOCKS blocks instead, of equal size.
    """
    if torch.compiler.is_exporting():
        from torch._higher_order_ops import scan

        def body(carried: Tensor, block: Carried) -> tuple[Tensor, Tensor]:
            return carried.clone(), function(*block)

        # `scan` refuses tensors that share memory with others that the function uses.
        blocks = tuple(x.unflatten(0, (EXPORTED_BLOCKS, x.shape[0] // EXPORTED_BLOCKS)).clone() for x in rows)
        computed: Tensor = scan(body, torch.zeros(1), blocks)[1]
        return computed.flatten(0, 1)
    return torch.cat([function(*block) for block in zip(*(x.split(at_once) for x in rows), strict=True)])
