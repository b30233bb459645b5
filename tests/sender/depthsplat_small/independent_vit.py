"""DINOv2's ViT-S/14 in numpy, written from its description, to check ours: features after the last norm."""

import numpy as np
from scipy.special import erf

CHANNELS, HEADS, PATCH, TRAINED_SIDE = 384, 6, 14, 37

Weights = dict[str, np.ndarray]


def made_up_image(height: int, width: int) -> np.ndarray:
    """Return smooth colours [3 height width] in [0, 1], the same on every machine."""
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float64)
    waves = [np.sin(rows / (9 + 5 * c) + c) * np.cos(columns / (13 - 3 * c)) for c in range(3)]
    return 0.5 + 0.4 * np.stack(waves)


def vit_features(weights: Weights, image: np.ndarray) -> np.ndarray:
    """Return features [channel rows columns], in float64. image: [3 height width] in [0, 1]."""
    weights = {name: value.astype(np.float64) for name, value in weights.items()}
    mean, deviation = np.array((0.485, 0.456, 0.406)), np.array((0.229, 0.224, 0.225))
    normalised = (image - mean[:, None, None]) / deviation[:, None, None]
    rows, columns = image.shape[1] // PATCH, image.shape[2] // PATCH
    patches = normalised.reshape(3, rows, PATCH, columns, PATCH).transpose(1, 3, 0, 2, 4).reshape(rows * columns, -1)
    kernel = weights["patch_embedding.weight"].reshape(CHANNELS, -1)
    tokens = patches @ kernel.T + weights["patch_embedding.bias"]
    embedding = weights["position_embedding"][0]
    tokens = tokens + resized(embedding[1:], rows, columns)
    x = np.concatenate((weights["class_token"][0] + embedding[:1], tokens))
    for block in range(12):
        x = transformer_block({k.removeprefix(f"blocks.{block}."): v for k, v in weights.items()}, x)
    return layer_norm(x, weights["norm.weight"], weights["norm.bias"])[1:].T.reshape(CHANNELS, rows, columns)


def transformer_block(weights: Weights, x: np.ndarray) -> np.ndarray:
    """Apply attention, then the MLP, each after a norm, scaled per channel, and added to its input."""
    h = layer_norm(x, weights["norm1.weight"], weights["norm1.bias"])
    qkv = (h @ weights["attention.qkv.weight"].T + weights["attention.qkv.bias"]).reshape(len(x), 3, HEADS, -1)
    query, key, value = qkv.transpose(1, 2, 0, 3)
    scores = query @ key.transpose(0, 2, 1) / np.sqrt(query.shape[-1])
    scores = np.exp(scores - scores.max(axis=-1, keepdims=True))
    attended = (scores / scores.sum(axis=-1, keepdims=True)) @ value
    joined = attended.transpose(1, 0, 2).reshape(len(x), CHANNELS)
    out = joined @ weights["attention.output.weight"].T + weights["attention.output.bias"]
    x = x + weights["layer_scale1"] * out
    h = layer_norm(x, weights["norm2.weight"], weights["norm2.bias"])
    h = h @ weights["mlp.fc1.weight"].T + weights["mlp.fc1.bias"]
    h = h * 0.5 * (1.0 + erf(h / np.sqrt(2.0)))
    return x + weights["layer_scale2"] * (h @ weights["mlp.fc2.weight"].T + weights["mlp.fc2.bias"])


def layer_norm(x: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Normalise over the channels."""
    centred = x - x.mean(axis=-1, keepdims=True)
    return centred / np.sqrt((centred**2).mean(axis=-1, keepdims=True) + 1e-6) * weight + bias


def resized(embedding: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Resize a position embedding of 37x37 patches bicubically, as DINOv2 does: with (n + 0.1) / 37 as the scale."""
    grid = embedding.reshape(TRAINED_SIDE, TRAINED_SIDE, CHANNELS)
    if (rows, columns) == (TRAINED_SIDE, TRAINED_SIDE):
        return embedding
    grid = np.einsum("rR,Rcd->rcd", cubic_matrix(rows), grid)
    return np.einsum("cC,rCd->rcd", cubic_matrix(columns), grid).reshape(rows * columns, CHANNELS)


def cubic_matrix(length: int) -> np.ndarray:
    """Return the weights [length 37] of cubic convolution (a = -0.75) with the border repeated."""
    a, matrix = -0.75, np.zeros((length, TRAINED_SIDE))
    for out in range(length):
        position = (out + 0.5) * TRAINED_SIDE / (length + 0.1) - 0.5
        for tap in range(int(np.floor(position)) - 1, int(np.floor(position)) + 3):
            d = abs(position - tap)
            near = (a + 2) * d**3 - (a + 3) * d**2 + 1
            far = a * d**3 - 5 * a * d**2 + 8 * a * d - 4 * a
            matrix[out, min(max(tap, 0), TRAINED_SIDE - 1)] += near if d <= 1 else far
    return matrix
