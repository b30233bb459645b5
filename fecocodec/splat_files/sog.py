"""Write 3D Gaussians as SOG version 2 of PlayCanvas: a ZIP of lossless WebP images and a `meta.json`.

Layout: specification of SOG 2 (developer.playcanvas.com). Each Gaussian is one pixel. Positions have 16 bits per axis
in a logarithmic domain, scales and colours a codebook of 256 values, harmonics a palette. The frame is that of the PLY.
"""

import json
import zipfile
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image
from scipy.spatial import KDTree

from fecocodec.geometry.kd_leaves import kd_leaves
from fecocodec.splat_files.gaussian_arrays import OutputGaussians, OutputScene, without_largest

MAX_PALETTE = 1 << 16
_RUN = 64  # Gaussians that are neighbours in the images
_PALETTE_COLUMNS = 64
_ROTATION_MODE = 252  # alpha of a rotation: this plus the index of the omitted component
_GAUSSIANS_PER_ENTRY = 2  # of the palette
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # equal input gives equal bytes
CODEBOOK_SIZE = 256
_SCALAR_STEPS, _VECTOR_STEPS = 20, 2  # of Lloyd's algorithm


def file_bytes(scene: OutputScene) -> bytes:
    """Return the bytes of the file. The Gaussians are reordered such that neighbouring pixels are alike."""
    gaussians = scene.gaussians.ordered(np.concatenate(kd_leaves(scene.gaussians.means, _RUN)))
    images: dict[str, UInt8[np.ndarray, "height width 4"]] = {}
    meta: dict[str, Any] = {"version": 2, "asset": {"generator": "FeCoSplat"}, "count": gaussians.count}
    meta["means"] = _add_means(images, gaussians.means)
    scales, codes = _by_codebook(gaussians.log_scales)
    images["scales.webp"] = _image(codes)
    meta["scales"] = {"codebook": scales, "files": ["scales.webp"]}
    largest, others = without_largest(gaussians.rotations)
    images["quats.webp"] = _image(_to_byte(others / np.sqrt(2) + 0.5), _ROTATION_MODE + largest)
    meta["quats"] = {"files": ["quats.webp"]}
    colours, codes = _by_codebook(gaussians.harmonics[:, 0])
    images["sh0.webp"] = _image(codes, _to_byte(gaussians.opacities))
    meta["sh0"] = {"codebook": colours, "files": ["sh0.webp"]}
    if gaussians.sh_degree:
        meta["shN"] = _add_harmonics(images, gaussians)
    return _zipped(meta, images)


def _add_means(images: dict[str, np.ndarray], means: Float[np.ndarray, "n 3"]) -> dict[str, Any]:
    """Add the low and the high bytes of the positions; return their description."""
    logarithmic = np.sign(means) * np.log1p(np.abs(means))
    low, high = logarithmic.min(axis=0), logarithmic.max(axis=0)
    steps = np.round((logarithmic - low) / np.where(high > low, high - low, 1) * 65535).astype(np.int64)
    images["means_l.webp"], images["means_u.webp"] = _image(steps & 255), _image(steps >> 8)
    return {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}


def _add_harmonics(images: dict[str, np.ndarray], gaussians: OutputGaussians) -> dict[str, Any]:
    """Add the palette of the harmonics above degree 0 and the entry of each Gaussian; return their description."""
    rest = gaussians.harmonics[:, 1:].reshape(gaussians.count, -1)
    size = min(MAX_PALETTE, -(-gaussians.count // _GAUSSIANS_PER_ENTRY))
    entries, labels = palette(rest, size)
    codebook, codes = _by_codebook(entries)
    num_coefficients = rest.shape[1] // 3
    height = -(-len(entries) // _PALETTE_COLUMNS)
    pixels = np.zeros((height * _PALETTE_COLUMNS, num_coefficients, 3), np.int64)
    pixels[: len(entries)] = codes.reshape(len(entries), num_coefficients, 3)
    images["shN_centroids.webp"] = _with_alpha(pixels.reshape(height, -1, 3), np.full((height, 1), 255))
    images["shN_labels.webp"] = _image(np.stack((labels & 255, labels >> 8, np.zeros_like(labels)), axis=1))
    files = ["shN_centroids.webp", "shN_labels.webp"]
    return {"count": len(entries), "bands": gaussians.sh_degree, "codebook": codebook, "files": files}


def _by_codebook(values: Float[np.ndarray, "*shape"]) -> tuple[list[float], Int[np.ndarray, "*shape"]]:
    codebook = scalar_codebook(values.ravel())
    return codebook.tolist(), nearest_in_codebook(codebook, values)


def _to_byte(shares: Float[np.ndarray, "*shape"]) -> Int[np.ndarray, "*shape"]:
    return np.round(shares * 255).clip(0, 255).astype(np.int64)


def _image(rgb: Int[np.ndarray, "n 3"], alpha: Int[np.ndarray, " n"] | None = None) -> UInt8[np.ndarray, "h w 4"]:
    """Arrange one pixel per Gaussian row by row in an image whose sides are multiples of four."""
    count = len(rgb)
    width = 4 * -(-int(np.ceil(np.sqrt(count))) // 4)
    height = 4 * -(-count // (4 * width))
    pixels = np.zeros((height * width, 4), np.uint8)
    pixels[:count, :3] = rgb
    pixels[:, 3] = 255
    if alpha is not None:
        pixels[:count, 3] = alpha
    return pixels.reshape(height, width, 4)


def _with_alpha(rgb: np.ndarray, alpha: np.ndarray) -> UInt8[np.ndarray, "h w 4"]:
    shape = (*rgb.shape[:2], 1)
    return np.concatenate((rgb, np.broadcast_to(alpha[..., None], shape)), axis=2).astype(np.uint8)


def _zipped(meta: dict[str, Any], images: dict[str, UInt8[np.ndarray, "height width 4"]]) -> bytes:
    """Return a ZIP archive without further compression."""
    data = BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_STORED) as archive:
        for name, pixels in images.items():
            encoded = BytesIO()
            # `exact` keeps the colours of pixels whose alpha, here an opacity, is 0.
            Image.fromarray(pixels, "RGBA").save(encoded, "WEBP", lossless=True, exact=True)
            archive.writestr(zipfile.ZipInfo(name, _ZIP_DATE), encoded.getvalue())
        archive.writestr(zipfile.ZipInfo("meta.json", _ZIP_DATE), json.dumps(meta))
    return data.getvalue()


def scalar_codebook(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, "256"]:
    """Return CODEBOOK_SIZE ascending values that represent `values` with little squared error (Lloyd-Max)."""
    ordered = np.sort(values)
    sums = np.concatenate(([0.0], np.cumsum(ordered)))
    quantiles = np.quantile(ordered, (np.arange(CODEBOOK_SIZE) + 0.5) / CODEBOOK_SIZE)
    uniform = np.linspace(ordered[0], ordered[-1], CODEBOOK_SIZE)
    codebook = np.sort((quantiles + uniform) / 2)  # quantiles alone leave the tails of long distributions empty
    for _ in range(_SCALAR_STEPS):
        edges = np.searchsorted(ordered, (codebook[1:] + codebook[:-1]) / 2)
        edges = np.concatenate(([0], edges, [len(ordered)]))
        counts = np.diff(edges)
        codebook = np.where(counts > 0, np.diff(sums[edges]) / np.maximum(counts, 1), codebook)
        codebook = np.maximum.accumulate(codebook)
    return codebook


def nearest_in_codebook(
    codebook: Float[np.ndarray, "256"], values: Float[np.ndarray, "*shape"]
) -> Int[np.ndarray, "*shape"]:
    """Return the index of the nearest entry of an ascending codebook."""
    return np.searchsorted((codebook[1:] + codebook[:-1]) / 2, values)


def palette(
    vectors: Float[np.ndarray, "n axis"], size: int
) -> tuple[Float[np.ndarray, "entry axis"], Int[np.ndarray, " n"]]:
    """Return at most `size` vectors that represent `vectors`, and the index of the nearest one for each.

    Starts with the means of the leaves of a k-d tree and refines them by Lloyd's algorithm.
    """
    run = -(-len(vectors) // size)
    labels = np.empty(len(vectors), np.int64)
    for number, leaf in enumerate(kd_leaves(vectors, run)):
        labels[leaf] = number
    for _ in range(_VECTOR_STEPS):
        entries = _means(vectors, labels)
        labels = KDTree(entries).query(vectors)[1]
    return entries, labels


def _means(vectors: Float[np.ndarray, "n axis"], labels: Int[np.ndarray, " n"]) -> Float[np.ndarray, "entry axis"]:
    """Return the mean of the vectors of each label that occurs."""
    _, labels, counts = np.unique(labels, return_inverse=True, return_counts=True)
    sums = [np.bincount(labels, weights=column) for column in vectors.T]
    return np.stack(sums, axis=1) / counts[:, None]
