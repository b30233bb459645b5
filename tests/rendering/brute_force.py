"""The textbook renderer in float64: every Gaussian at every pixel, nothing shared with the kernels.

The Jacobian of the projection and all gradients come from torch's differentiation.
"""

import torch
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians


def render_brute_force(
    gaussians: Gaussians, cameras: Cameras, image_size: tuple[int, int], background: tuple[float, float, float]
) -> tuple[Tensor, Tensor, Tensor]:
    """(color, depth, alpha) as `fecocodec.rendering.rasterizer.render` defines them."""
    views = [
        _render_view(gaussians, pose, intrinsics, image_size, background, 0.1 * float(cameras.near))
        for pose, intrinsics in zip(
            cameras.extrinsics.double(), cameras.intrinsics_px(*image_size).double(), strict=True
        )
    ]
    color, depth, alpha = zip(*views, strict=True)
    return torch.stack(color), torch.stack(depth), torch.stack(alpha)


def project_mean(point: Tensor, intrinsics: Tensor) -> Tensor:
    """Pixel position of a point in camera axes."""
    homogeneous = intrinsics @ point
    return homogeneous[:2] / homogeneous[2]


def projected_covariance(point: Tensor, covariance: Tensor, intrinsics: Tensor, image_size: tuple[int, int]) -> Tensor:
    """EWA: J Sigma J^T + 0.3 I for a mean and covariance in camera axes.

    J is taken at a point moved to at most 30% of half the field of view outside the image, as 3DGS does.
    """
    height, width = image_size
    size = point.new_tensor([width, height])
    focal, centre = torch.stack((intrinsics[0, 0], intrinsics[1, 1])), intrinsics[:2, 2]
    margin = 0.15 * size / focal
    slope = torch.clamp(point[:2] / point[2], -centre / focal - margin, (size - centre) / focal + margin)
    inside = torch.cat((slope * point[2], point[2:]))
    jacobian = torch.func.jacrev(lambda p: project_mean(p, intrinsics))(inside)
    return jacobian @ covariance @ jacobian.T + 0.3 * torch.eye(2, dtype=point.dtype)


def rotation_matrix(quaternion: Tensor) -> Tensor:
    """Rotation of a quaternion wxyz by its definition, v -> q v q*."""
    w, v = quaternion[0] / quaternion.norm(), quaternion[1:] / quaternion.norm()
    zero = torch.zeros_like(w)
    cross = torch.stack(
        (
            torch.stack((zero, -v[2], v[1])),
            torch.stack((v[2], zero, -v[0])),
            torch.stack((-v[1], v[0], zero)),
        )
    )
    return torch.eye(3, dtype=v.dtype) + 2 * w * cross + 2 * cross @ cross


def sh_basis(direction: Tensor) -> Tensor:
    """The 16 real spherical harmonics up to degree 3 at a unit direction, with the signs 3DGS gives them."""
    x, y, z = direction
    pi = torch.pi
    return torch.stack(
        (
            torch.full_like(x, (1 / (4 * pi)) ** 0.5),
            -((3 / (4 * pi)) ** 0.5) * y,
            (3 / (4 * pi)) ** 0.5 * z,
            -((3 / (4 * pi)) ** 0.5) * x,
            (15 / (4 * pi)) ** 0.5 * x * y,
            -((15 / (4 * pi)) ** 0.5) * y * z,
            (5 / (16 * pi)) ** 0.5 * (2 * z * z - x * x - y * y),
            -((15 / (4 * pi)) ** 0.5) * x * z,
            (15 / (16 * pi)) ** 0.5 * (x * x - y * y),
            -((35 / (32 * pi)) ** 0.5) * y * (3 * x * x - y * y),
            (105 / (4 * pi)) ** 0.5 * x * y * z,
            -((21 / (32 * pi)) ** 0.5) * y * (4 * z * z - x * x - y * y),
            (7 / (16 * pi)) ** 0.5 * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -((21 / (32 * pi)) ** 0.5) * x * (4 * z * z - x * x - y * y),
            (105 / (16 * pi)) ** 0.5 * z * (x * x - y * y),
            -((35 / (32 * pi)) ** 0.5) * x * (x * x - 3 * y * y),
        )
    )


def _render_view(
    gaussians: Gaussians,
    pose: Tensor,
    intrinsics: Tensor,
    image_size: tuple[int, int],
    background: tuple[float, float, float],
    near: float,
) -> tuple[Tensor, Tensor, Tensor]:
    height, width = image_size
    rotation, eye = pose[:3, :3].T, pose[:3, 3]
    points = (gaussians.means - eye) @ rotation.T
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    pixels = torch.stack((x, y), dim=-1).double()
    transmittance = torch.ones(height, width, dtype=torch.float64)
    color, depth = torch.zeros(3, height, width).double(), torch.zeros(height, width).double()
    for i in points[:, 2].argsort().tolist():
        if points[i, 2] < near:
            continue
        axes = rotation @ rotation_matrix(gaussians.rotations[i]) @ torch.diag(gaussians.scales[i])
        covariance = projected_covariance(points[i], axes @ axes.T, intrinsics, image_size)
        offset = pixels - project_mean(points[i], intrinsics)
        exponent = 0.5 * torch.einsum("hwi,ij,hwj->hw", offset, torch.linalg.inv(covariance), offset)
        alpha = torch.clamp(gaussians.opacities[i] * torch.exp(-exponent), max=0.999)
        alpha = torch.where((alpha >= 1 / 255) & (transmittance >= 1e-4), alpha, 0.0)
        direction = gaussians.means[i] - eye
        basis = sh_basis(direction / direction.norm())[: gaussians.harmonics.shape[1]]
        shade = torch.clamp(0.5 + basis @ gaussians.harmonics[i], min=0.0)
        color = color + alpha * transmittance * shade[:, None, None]
        depth = depth + alpha * transmittance * points[i, 2]
        transmittance = transmittance * (1 - alpha)
    covered = 1 - transmittance
    color = color + transmittance * torch.tensor(background, dtype=torch.float64)[:, None, None]
    return color, torch.where(covered > 0, depth / covered.clamp(min=1e-9), 0.0), covered
