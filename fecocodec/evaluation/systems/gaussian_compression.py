"""Baseline that transmits Gaussians, predicted without coding, in the file formats of splat viewers.

Formats are PLY, compressed PLY (PlayCanvas) and SPZ (Niantic); the latter two need gsply.
"""

import tempfile
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import torch

from fecocodec.errors import InputError
from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.splat_files.ply import read_ply, write_ply

GAUSSIAN_FORMATS = ("PLY", "compressed PLY", "SPZ")


def encode_gaussians(gaussians: Gaussians, form: str) -> bytes:
    """Return the bytes of the file. form: one of GAUSSIAN_FORMATS.

    SPZ is version 4 (zstd), with positions in steps of 2^-12 scene units. Raises InputError if gsply is not installed,
    or if the form is unknown.
    """
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder, "scene.ply")
        write_ply(plain, gaussians)
        if form == "PLY":
            return plain.read_bytes()
        gsply = require_extra("gsply", f"writing {form}")
        cloud = gsply.plyread(str(plain))
        if form == "compressed PLY":
            return bytes(gsply.compress_to_bytes(cloud))
        if form == "SPZ":
            gsply.write_spz(Path(folder, "scene.spz"), cloud, version=4)
            return Path(folder, "scene.spz").read_bytes()
    raise InputError(f"Gaussian format {form} is unknown; use one of {', '.join(GAUSSIAN_FORMATS)}.")


def decode_gaussians(data: bytes, form: str) -> Gaussians:
    """Decode the bytes of `encode_gaussians`. The order of the Gaussians can change."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scene.spz" if form == "SPZ" else "scene.ply")
        path.write_bytes(data)
        if form == "PLY":
            return read_ply(path)
        gsply = require_extra("gsply", f"reading {form}")
        cloud = gsply.read_spz(path) if form == "SPZ" else gsply.decompress_from_bytes(data)
        rest = np.zeros((len(cloud.means), 0, 3)) if cloud.shN is None else cloud.shN.reshape(len(cloud.means), -1, 3)
        harmonics = np.concatenate((cloud.sh0[:, None], rest), axis=1)
        return Gaussians(
            means=_tensor(cloud.means),
            scales=_tensor(np.exp(cloud.scales)),
            rotations=torch.nn.functional.normalize(_tensor(cloud.quats), dim=-1),
            opacities=torch.sigmoid(_tensor(cloud.opacities)),
            harmonics=_tensor(harmonics),
        )


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))


def gaussian_systems(codec: Codec) -> tuple[System, ...]:
    """Return one system per format, with the default latent optimisation. PLY is lossless: an upper bound."""
    return tuple(System(form, "uncoded networks", partial(_reconstruct, codec, form)) for form in GAUSSIAN_FORMATS)


def _reconstruct(codec: Codec, form: str, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    context = views.select(list(range(num_context)))
    data = encode_gaussians(uncoded_gaussians(codec, context, DEFAULT), form)
    encoded = perf_counter()
    gaussians = decode_gaussians(data, form)
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)
