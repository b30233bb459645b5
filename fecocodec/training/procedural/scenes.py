"""Procedural scenes: photo-like views of random worlds with exact cameras and depth."""

from dataclasses import dataclass, field

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float
from numpy import ndarray

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.views import Views
from fecocodec.training.procedural.cameras import PathRange, place_cameras
from fecocodec.training.procedural.images import Pinholes, cast_images
from fecocodec.training.procedural.layout import lay_out
from fecocodec.training.procedural.solids import random_rotation
from fecocodec.training.procedural.textures import Textures
from fecocodec.training.samples import Sample


@dataclass(frozen=True)
class ProceduralWorld:
    """Draws a new random world for every sample.

    textures: of its surfaces. complexity: range, from 0 (bare walls) to 1 (crowded). path: distribution of cameras.
    decades: the unit of length is log-uniform over this many decades around the metre.
    """

    textures: Textures
    complexity: tuple[float, float] = (0.1, 1.0)
    path: PathRange = field(default_factory=PathRange)
    decades: float = 4.0

    def sample(self, generator: torch.Generator, *, num_context: int, num_target: int, size: tuple[int, int]) -> Sample:
        """Draw one scene with exact depth; size: (height, width) in pixels. Equal states give equal samples."""
        rng = np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
        complexity = float(rng.uniform(*self.complexity))
        unit = 10 ** float(rng.uniform(-self.decades / 2, self.decades / 2))
        stage = lay_out(rng, len(self.textures), complexity)
        pinholes = place_cameras(rng, stage, self.path, num_context, num_target, size)
        light, depth = cast_images(stage.world, self.textures, pinholes)
        images = _develop(rng, light)
        names = tuple(f"view {view}" for view in range(len(images)))
        cameras = _cameras(rng, pinholes, depth, unit)
        views = Views(torch.from_numpy(rearrange(images, "v h w rgb -> v rgb h w").copy()), cameras, names)
        return Sample(views, num_context, torch.from_numpy(depth * np.float32(unit)))


def _develop(
    rng: np.random.Generator, light: Float[ndarray, "view height width 3"]
) -> Float[ndarray, "view height width 3"]:
    """Convert linear light to sRGB-like photographs: one exposure and white balance, a tone curve, sensor noise."""
    exposure = rng.uniform(0.1, 0.35) / max(float(light.mean()), 1e-3)
    balance = np.exp(rng.normal(0, 0.12, 3)) * exposure
    noise_level = rng.uniform(0.0, 0.015)
    per_view = np.exp(rng.normal(0, 0.02, (len(light), 1, 1, 1)))
    exposed = light * (balance * per_view).astype(np.float32)
    # A shoulder keeps detail in highlights, as in cameras: linear up to 0.7, then approaching 1.
    bent = np.where(exposed > 0.7, 1 - 0.3 * np.exp((0.7 - exposed) / 0.3), exposed)
    contrast = rng.uniform(0.0, 0.6)
    toned = np.sqrt(bent)
    toned += contrast * toned * (1 - toned) * (2 * toned - 1)
    noise = rng.standard_normal(light.shape, dtype=np.float32) * np.float32(noise_level)
    developed: ndarray = np.clip(toned + noise, 0, 1).astype(np.float32)
    return developed


def _cameras(
    rng: np.random.Generator, pinholes: Pinholes, depth: Float[ndarray, "view height width"], unit: float
) -> Cameras:
    """Return cameras in a random world frame and unit of length; near and far are widened quantiles of depth."""
    height, width = pinholes.size
    turn = random_rotation(rng)
    extrinsics = np.tile(np.eye(4), (len(pinholes.eyes), 1, 1))
    extrinsics[:, :3, :3] = turn @ pinholes.rotations
    extrinsics[:, :3, 3] = (pinholes.eyes - pinholes.eyes.mean(0)) @ turn.T * unit
    intrinsics = np.array(
        [
            [pinholes.focal / width, 0.0, pinholes.centre[0] / width],
            [0.0, pinholes.focal / height, pinholes.centre[1] / height],
            [0.0, 0.0, 1.0],
        ]
    )
    near, far = np.quantile(depth, (0.01, 0.99)) * unit
    return Cameras(
        extrinsics=torch.from_numpy(extrinsics).float(),
        intrinsics=torch.from_numpy(intrinsics).float().expand(len(extrinsics), 3, 3),
        near=torch.tensor(near / 1.15, dtype=torch.float32),
        far=torch.tensor(far * 1.15, dtype=torch.float32),
    )
