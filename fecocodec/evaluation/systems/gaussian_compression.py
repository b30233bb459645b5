"""Baseline that transmits Gaussians, predicted without coding, as SPZ (Niantic), by gsply.

The more alike neighbours are merged, the smaller is the file.
"""

import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import torch

from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import DECODED, uncoded_gaussians
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.merging.grouping import MergingConfig
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.splat_files.ply import write_ply

SPZ = "SPZ"
LARGEST_COSTS = (0.0, MergingConfig.largest_cost, 1e-2, 1e6)  # of merging; the last leaves one of 16 Gaussians


def encode_spz(gaussians: Gaussians) -> bytes:
    """Return the bytes of the file: version 4 (zstd), with positions in steps of 2^-12 scene units.

    Raises InputError if gsply is not installed.
    """
    gsply = require_extra("gsply", f"writing {SPZ}")
    with tempfile.TemporaryDirectory() as folder:
        plain, path = Path(folder, "scene.ply"), Path(folder, "scene.spz")
        write_ply(plain, gaussians)
        gsply.write_spz(path, gsply.plyread(str(plain)), version=4)
        return path.read_bytes()


def decode_spz(data: bytes) -> Gaussians:
    """Decode the bytes of `encode_spz`. The order of the Gaussians can change."""
    gsply = require_extra("gsply", f"reading {SPZ}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scene.spz")
        path.write_bytes(data)
        cloud = gsply.read_spz(path)
    rest = np.zeros((len(cloud.means), 0, 3)) if cloud.shN is None else cloud.shN.reshape(len(cloud.means), -1, 3)
    return Gaussians(
        means=_tensor(cloud.means),
        scales=_tensor(np.exp(cloud.scales)),
        rotations=torch.nn.functional.normalize(_tensor(cloud.quats), dim=-1),
        opacities=torch.sigmoid(_tensor(cloud.opacities)),
        harmonics=_tensor(np.concatenate((cloud.sh0[:, None], rest), axis=1)),
    )


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))


def spz_systems(codec: Codec) -> tuple[System, ...]:
    """Return one system per bound on the cost of merging, with the default latent optimisation."""
    return tuple(System(SPZ, f"merging {cost:g}", partial(_reconstruct, codec, cost)) for cost in LARGEST_COSTS)


def _reconstruct(codec: Codec, largest_cost: float, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    emission = replace(DECODED, merging=MergingConfig(largest_cost) if largest_cost else None)
    data = encode_spz(uncoded_gaussians(codec, views.select(list(range(num_context))), DEFAULT, emission))
    encoded = perf_counter()
    gaussians = decode_spz(data)
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)
