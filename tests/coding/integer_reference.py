"""Independent reference of the decoding process of ENTROPY.md, in int64, position by position."""

import numpy as np

from tests.entropy.ans_reference import ReferenceAns, decode_batch

Weights = dict[str, np.ndarray]


def layer(weights: Weights, name: str, x: np.ndarray, group: int = 0) -> np.ndarray:
    weight, bias = weights[f"{name}.weight"][group].astype(np.int64), weights[f"{name}.bias"][group].astype(np.int64)
    sums = x.astype(np.int64) @ weight[: x.shape[-1]] + bias
    return np.clip((sums + 2048) >> 12, -32768, 32767)


def relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0)


def around(x: np.ndarray, view: int, row: int, column: int) -> np.ndarray:
    columns = []
    for i in (row - 1, row, row + 1):
        for j in (column - 1, column, column + 1):
            inside = 0 <= i < x.shape[1] and 0 <= j < x.shape[2]
            columns.append(x[view, i, j] if inside else np.zeros_like(x[view, 0, 0]))
    return np.clip(np.concatenate(columns), -32768, 32767)


def everywhere(x: np.ndarray, function) -> np.ndarray:
    views, height, width = x.shape[:3]
    return np.array([[[function(v, i, j) for j in range(width)] for i in range(height)] for v in range(views)])


def double(x: np.ndarray) -> np.ndarray:
    views, height, width, channels = x.shape
    out = np.zeros((views, 2 * height, 2 * width, channels // 4), dtype=np.int64)
    for phase, part in enumerate(np.split(x, 4, axis=-1)):
        out[:, phase // 2 :: 2, phase % 2 :: 2] = part
    return out


def table_index(position: np.ndarray) -> np.ndarray:
    return np.clip(22 + ((position + 16) >> 5), 0, 63)


def features(weights: Weights, z_hat: np.ndarray, condition: np.ndarray, context: np.ndarray | None) -> np.ndarray:
    x = everywhere(z_hat, lambda v, i, j: relu(layer(weights, "enter", np.append(around(z_hat, v, i, j), condition))))
    x = double(relu(layer(weights, "up_16", x)))
    x = everywhere(x, lambda v, i, j, x=x: relu(layer(weights, "around_16", around(x, v, i, j))))
    x = double(relu(layer(weights, "up_8", x)))

    def merge(v: int, i: int, j: int) -> np.ndarray:
        seen = [] if context is None else [around(context, v, i, j)]
        return relu(layer(weights, "merge_8", np.concatenate([x[v, i, j], condition, *seen])))

    return everywhere(x, merge)


def decode(
    weights: Weights,
    payload: bytes,
    size_8: tuple[int, int, int],
    lambda_q: int,
    stage: int,
    context: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return z_hat and y_hat, Q8, [view row column channel]. context: y_hat of stage 1, Q8."""
    views, height, width = size_8
    ans = ReferenceAns(payload)
    condition = np.zeros(4, dtype=np.int64)
    condition[stage - 1], condition[stage + 1] = 256, lambda_q - 884
    mean, position = np.split(layer(weights, "hyper_prior", condition), 2)
    tables = np.broadcast_to(table_index(position), (views, height // 4, width // 4, 16))
    z_hat = decode_batch(ans, tables) * 256 + mean

    known = features(weights, z_hat, condition, context)
    earlier = [first_step(weights, ans, known)]
    y_hat = np.zeros((views, height, width, 32), dtype=np.int64)
    for step in (1, 2, 3):
        positions, means, tables = [], [], []
        for phase in range(4):
            for v in range(views):
                for i in range(phase // 2, height, 2):
                    for j in range(phase % 2, width, 2):
                        x = np.concatenate([known[v, i, j], *(around(before, v, i, j) for before in earlier)])
                        mean, position = np.split(three_layers(weights, f"steps.{step}", x, phase), 2)
                        positions.append((v, i, j))
                        means.append(mean)
                        tables.append(table_index(position))
        values = decode_batch(ans, np.array(tables)) * 256 + np.array(means)
        this = np.zeros((views, height, width, 8), dtype=np.int64)
        for (v, i, j), value in zip(positions, values, strict=True):
            this[v, i, j] = value
        earlier.append(this)
    for this, flip in zip(earlier, (0, 3, 2, 1), strict=True):
        for v, i, j in np.ndindex(views, height, width):
            quarter = (2 * (i % 2) + j % 2) ^ flip
            y_hat[v, i, j, 8 * quarter : 8 * quarter + 8] = this[v, i, j]
    assert ans.is_empty()
    return z_hat, y_hat


def first_step(weights: Weights, ans: ReferenceAns, known: np.ndarray) -> np.ndarray:
    """Decode step 0 in three passes over blocks of 2x2 positions; returns [view row column 8]."""
    views, height, width, _ = known.shape
    this = np.zeros((views, height, width, 8), dtype=np.int64)
    offsets = [], [(-1, -1), (-1, 1), (1, -1), (1, 1)], [(-1, 0), (0, -1), (0, 1), (1, 0)]
    members = [lambda i, j: i % 2 + j % 2 == 0, lambda i, j: i % 2 + j % 2 == 2, lambda i, j: i % 2 + j % 2 == 1]
    for number in range(3):
        blocks = [b for b in np.ndindex(views, height // 2, width // 2) if members[number](b[1], b[2])]
        found = []
        for v, i, j in blocks:
            total = known[v, 2 * i : 2 * i + 2, 2 * j : 2 * j + 2].sum(axis=(0, 1))
            parts = [total]
            for a, b in offsets[number]:
                inside = 0 <= i + a < height // 2 and 0 <= j + b < width // 2
                block = this[v, 2 * (i + a) :, 2 * (j + b) :][:2, :2] if inside else np.zeros((2, 2, 8), dtype=np.int64)
                parts.append(block.reshape(32))
            x = np.clip(np.concatenate(parts), -32768, 32767)
            found.append(three_layers(weights, f"passes.{number}", x).reshape(4, 2, 8))
        mean, position = np.array(found).transpose(2, 1, 0, 3)  # each [phase block channel]
        values = decode_batch(ans, table_index(position)) * 256 + mean
        for phase in range(4):
            for (v, i, j), value in zip(blocks, values[phase], strict=True):
                this[v, 2 * i + phase // 2, 2 * j + phase % 2] = value
    return this


def three_layers(weights: Weights, name: str, x: np.ndarray, group: int = 0) -> np.ndarray:
    for part in ("enter", "middle"):
        x = relu(layer(weights, f"{name}.{part}", x, group))
    return layer(weights, f"{name}.leave", x, group)
