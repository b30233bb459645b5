"""Valid streams that no sender makes: random latents and detail, and cameras anywhere within their bounds."""

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

import numpy as np
import torch

from fecocodec.coding.detail import detail_size, encode_detail
from fecocodec.coding.payload import encode_latents
from fecocodec.container import MAX_DETAIL_STEP, Detail, Header, PackedCameras, Stream, write_stream
from fecocodec.container.camera_validation import (
    MAX_COORDINATE,
    MAX_DEPTH_RATIO,
    MAX_DISTANCE,
    MAX_FOCAL,
    MAX_NEAR,
    MAX_PRINCIPAL_POINT,
    MIN_DEPTH_RATIO,
    MIN_FOCAL,
    MIN_NEAR,
    check_cameras,
)
from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.container.view_grids import COVERAGE_CELLS, FADING_BLOCKS
from fecocodec.errors import BitstreamError
from fecocodec.receiver.model import Receiver
from tests.container.example_streams import float32, grid_bytes, pose, rotation_of

LATENT, HYPER = 8, 32  # pixels per latent and per hyper-latent
SIZES = ((64, 64), (64, 96), (96, 64))
NOISE = (0.0, 0.1, 1.0, 10.0, 300.0)  # standard deviation of the latents


@dataclass(frozen=True)
class CodedLatents:
    """Payloads of valid streams, with the header that describes them. detail: None if the model has none."""

    header: Header
    payloads: tuple[bytes, ...]
    detail: Detail | None


@torch.no_grad()
def code_random_latents(random: Random, receiver: Receiver, model_id: bytes) -> CodedLatents:
    """Code Gaussian noise as the latents of one to three small views, in one or two stages."""
    generator = torch.Generator().manual_seed(int(random.random() * 2**31))
    views, (height, width), noise = random.randint(1, 3), random.choice(SIZES), random.choice(NOISE)
    num_stages = random.randint(1, 2)
    excess = random.randint(0, 255) if num_stages == 2 else 0
    header = Header(model_id, views, height, width, random.randint(0, LAMBDA_Q_MAX), (bytes(8),) * num_stages, excess)
    payloads, digests, context = [], [], None
    for stage in range(1, num_stages + 1):
        y, z = (
            noise * torch.randn(views, channels, height // step, width // step, generator=generator)
            for channels, step in ((receiver.config.latent_channels, LATENT), (receiver.config.hyper_channels, HYPER))
        )
        payload, coded = encode_latents(receiver.prior, y, z, header.lambda_q_of_stage(stage), stage, context)
        payloads.append(payload)
        digests.append(coded.digest())
        context = coded.y_hat
    header = Header(model_id, views, height, width, header.lambda_q, tuple(digests), excess)
    return CodedLatents(header, tuple(payloads), random_detail(random, receiver, header))


def random_detail(random: Random, receiver: Receiver, header: Header) -> Detail | None:
    """Code Gaussian noise as detail; returns None if the model has no detail."""
    if receiver.detail is None:
        return None
    noise, generator = random.choice(NOISE), np.random.default_rng(int(random.random() * 2**31))
    payload, _ = encode_detail(
        receiver.detail.tables.numpy(),
        lambda _, indices: np.round(noise * generator.standard_normal(indices.shape)).astype(np.int32),
        detail_size(header),
    )
    return Detail(random.randint(0, MAX_DETAIL_STEP), payload)


def forged_stream(random: Random, latents: Sequence[CodedLatents]) -> bytes:
    """Return a stream of one of the coded latents with random cameras.

    In one of four it has random coverage, in one of four random fading, in one of two detail if the model has it.
    """
    coded = latents[int(random.random() * len(latents))]
    coverage, fading = (
        random.randbytes(grid_bytes(grids, coded.header)) if random.random() < 0.25 else None
        for grids in (COVERAGE_CELLS, FADING_BLOCKS)
    )
    detail = coded.detail if coded.detail is not None and random.random() < 0.5 else None
    cameras = valid_cameras(random, coded.header.num_views)
    stream = Stream(coded.header, cameras, coded.payloads, coverage=coverage, fading=fading, detail=detail)
    return write_stream(stream)


def valid_cameras(random: Random, num_views: int) -> PackedCameras:
    while True:
        cameras = random_cameras(random, num_views)
        try:
            check_cameras(cameras, "cameras")
        except BitstreamError:  # a few are just outside a bound, because they were rounded to float32
            continue
        return cameras


def random_cameras(random: Random, num_views: int) -> PackedCameras:
    """Return cameras whose values are spread over the orders of magnitude that the format allows."""
    near = float32(spread(random, MIN_NEAR, MAX_NEAR) if random.random() < 0.5 else 1.0)
    far = float32(near * spread(random, MIN_DEPTH_RATIO, MAX_DEPTH_RATIO))
    distance = near * spread(random, 2.0**-20, MAX_DISTANCE)
    centre = [random.uniform(-1.0, 1.0) * spread(random, near, MAX_COORDINATE) for _ in range(3)]
    centre = centre if random.random() < 0.2 else [0.0] * 3
    poses = tuple(random_pose(random, centre, distance) for _ in range(num_views))
    lenses = tuple(random_lens(random) for _ in range(num_views))
    return PackedCameras(poses, lenses if random.random() < 0.5 else lenses[:1] * num_views, near, far)


def random_pose(random: Random, centre: Sequence[float], distance: float) -> tuple[float, ...]:
    """Return the first three rows of camera-to-world, row-major."""
    w, x, y, z = (random.gauss(0.0, 1.0) for _ in range(4))
    if random.random() < 0.5:
        w, x, y, z = 1.0, 0.0, 0.0, 0.0
    moved = tuple(value + distance * random.choice((-1.0, 0.0, random.uniform(-1.0, 1.0), 1.0)) for value in centre)
    return pose(rotation_of(w, x, y, z), moved)


def random_lens(random: Random) -> tuple[float, float, float, float]:
    focal = spread(random, MIN_FOCAL, MAX_FOCAL)
    other = focal if random.random() < 0.5 else spread(random, MIN_FOCAL, MAX_FOCAL)
    centres = (0.5 if random.random() < 0.5 else random.uniform(-1, 1) * MAX_PRINCIPAL_POINT for _ in range(2))
    return (float32(focal), float32(other), *(float32(value) for value in centres))  # type: ignore[return-value]


def spread(random: Random, lowest: float, highest: float) -> float:
    """Return a value between two positive bounds: one of them, or one that is uniform in the logarithm."""
    share = random.choice((0.0, 1.0, random.random(), random.random()))
    return float(min(max(lowest * (highest / lowest) ** share, lowest), highest))
