"""The decoding process of ENTROPY.md in int64, position by position as the text has it; slow and independent."""

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
    """z_hat and y_hat, Q8, [view row column channel]; context: y_hat Q8 of stage 1."""
    views, height, width = size_8
    ans = ReferenceAns(payload)
    condition = np.zeros(4, dtype=np.int64)
    condition[stage - 1], condition[stage + 1] = 256, lambda_q - 884
    mean, position = np.split(layer(weights, "hyper_prior", condition), 2)
    tables = np.broadcast_to(table_index(position), (views, height // 4, width // 4, 16))
    z_hat = decode_batch(ans, tables) * 256 + mean

    known = features(weights, z_hat, condition, context)
    y_hat = np.zeros((views, height, width, 32), dtype=np.int64)
    earlier: list[np.ndarray] = []
    for step, flip in enumerate((0, 3, 2, 1)):
        elements, means, tables = [], [], []
        for phase in range(4):
            for v in range(views):
                for i in range(phase // 2, height, 2):
                    for j in range(phase % 2, width, 2):
                        x = np.concatenate([known[v, i, j], *(around(before, v, i, j) for before in earlier)])
                        x = relu(layer(weights, f"steps.{step}.enter", x, phase))
                        x = relu(layer(weights, f"steps.{step}.middle", x, phase))
                        mean, position = np.split(layer(weights, f"steps.{step}.leave", x, phase), 2)
                        elements.append((v, i, j, phase ^ flip))
                        means.append(mean)
                        tables.append(table_index(position))
        values = decode_batch(ans, np.array(tables)) * 256 + np.array(means)
        this = np.zeros((views, height, width, 8), dtype=np.int64)
        for (v, i, j, quarter), value in zip(elements, values, strict=True):
            this[v, i, j] = value
            y_hat[v, i, j, 8 * quarter : 8 * quarter + 8] = value
        earlier.append(this)
    assert ans.is_empty()
    return z_hat, y_hat
