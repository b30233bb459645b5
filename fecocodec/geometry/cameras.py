"""Pinhole cameras: extrinsics are camera-to-world in OpenCV axes, intrinsics are normalised by width and height."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.gaussian_arrays import SceneCameras

LEAST_DEPTH = 1e-6  # in units of near; points closer than this are not visible
OUTSIDE = 4.0  # limit of image positions that are sampled, and that of points behind the camera; outside of every image


class Projection(NamedTuple):
    """Projections of points into every camera of a scene.

    uv: image positions divided by image width and height, inside the image in [0, 1]; arbitrary behind the camera.
    depth: along the optical axis, in scene units, negative behind the camera.
    is_visible: whether the point lies in front of the camera and inside its image; occlusion is not considered.
    """

    uv: Float[Tensor, "view *grid 2"]
    depth: Float[Tensor, "view *grid"]
    is_visible: Bool[Tensor, "view *grid"]


@dataclass(frozen=True)
class Cameras:
    """The cameras of one scene, or of a batch of scenes with equally many views.

    extrinsics: camera-to-world, OpenCV axes (+X right, +Y down, +Z forward), scene units.
    intrinsics: 3x3, focal lengths and principal point divided by image width (row 0) and height (row 1);
        pixel centres lie at (i + 0.5) / n.
    near, far: bounds of depth (z along the optical axis) in scene units, shared by the views of a scene.
    """

    extrinsics: Float[Tensor, "*batch view 4 4"]
    intrinsics: Float[Tensor, "*batch view 3 3"]
    near: Float[Tensor, "*batch"]
    far: Float[Tensor, "*batch"]

    @classmethod
    def of(cls, cameras: "Cameras | SceneCameras") -> "Cameras":
        """Return cameras as tensors; those of arrays share their memory."""
        return cls(*map(torch.as_tensor, cameras.fields()))

    @classmethod
    def in_float32(cls, extrinsics: Any, intrinsics: Any, near: float, far: float) -> "Cameras":
        """Return cameras of arrays, which may be in float64."""
        return cls(*(torch.as_tensor(x, dtype=torch.float32) for x in (extrinsics, intrinsics, near, far)))

    def arrays(self) -> SceneCameras:
        """Return the cameras of one scene as arrays; those of tensors on the CPU share their memory."""
        extrinsics, intrinsics, near, far = (field.cpu().numpy() for field in self.fields())
        return SceneCameras(extrinsics, intrinsics, float(near), float(far))

    @property
    def num_views(self) -> int:
        return self.extrinsics.shape[-3]

    @property
    def world_to_camera(self) -> Float[Tensor, "*batch view 4 4"]:
        """Return the inverse of the extrinsics, assuming rigid poses: the rotation is transposed."""
        rotation = self.extrinsics[..., :3, :3].transpose(-1, -2)
        translation = -rotation @ self.extrinsics[..., :3, 3:]
        last_row = self.extrinsics[..., 3:, :]
        return torch.cat((torch.cat((rotation, translation), dim=-1), last_row), dim=-2)

    def project(self, points: Float[Tensor, "*grid 3"]) -> Projection:
        """Project points, in the world frame, into all cameras of one scene (no batch dimension)."""
        inverse = self.world_to_camera
        rotated = torch.einsum("vij,...j->v...i", inverse[:, :3, :3], points)
        local = rotated + inverse[:, :3, 3].view(-1, *(1,) * (points.dim() - 1), 3)
        depth = local[..., 2]
        is_in_front = depth > LEAST_DEPTH * self.near
        uv = to_image(local.reshape(self.num_views, -1, 3), self.intrinsics, is_in_front.reshape(self.num_views, -1))
        uv = uv.view(*depth.shape, 2)
        return Projection(uv, depth, is_in_front & ((uv >= 0) & (uv <= 1)).all(dim=-1))

    def intrinsics_px(self, height: int, width: int) -> Float[Tensor, "*batch view 3 3"]:
        """Return the intrinsics in pixels for images of this size; pixel centres lie at i + 0.5."""
        size = self.intrinsics.new_tensor([width, height, 1.0])
        return self.intrinsics * size[:, None]

    def select(self, views: list[int]) -> "Cameras":
        """Return the cameras of these views, in this order."""
        return replace(self, extrinsics=self.extrinsics[..., views, :, :], intrinsics=self.intrinsics[..., views, :, :])

    def joined(self, others: "Cameras") -> "Cameras":
        """Return these views, then the others, which have the same batch dimensions; the depth bounds are kept."""
        extrinsics = torch.cat((self.extrinsics, others.extrinsics), dim=-3)
        return replace(self, extrinsics=extrinsics, intrinsics=torch.cat((self.intrinsics, others.intrinsics), dim=-3))

    def scene(self, index: int) -> "Cameras":
        """Return the cameras of one scene of a batch."""
        return Cameras(*(field[index] for field in self.fields()))

    def as_batch(self) -> "Cameras":
        """Add a batch dimension of size 1."""
        return Cameras(*(field[None] for field in self.fields()))

    def to(self, device: torch.device | str) -> "Cameras":
        return Cameras(*(field.to(device) for field in self.fields()))

    def fields(self) -> tuple[Tensor, ...]:
        return self.extrinsics, self.intrinsics, self.near, self.far


def to_image(
    points: Float[Tensor, "*camera point 3"],
    intrinsics: Float[Tensor, "*camera 3 3"],
    is_in_front: Bool[Tensor, "*camera point"],
) -> Float[Tensor, "*camera point 2"]:
    """Project points in the frame of their camera to normalised positions; arbitrary ones for points behind it."""
    projected = points @ intrinsics.mT
    return projected[..., :2] / torch.where(is_in_front, points[..., 2], 1.0)[..., None]


def image_positions(
    points: Float[Tensor, "*camera point 3"], intrinsics: Float[Tensor, "*camera 3 3"], least_depth: float = LEAST_DEPTH
) -> Float[Tensor, "*camera point 2"]:
    """Return where images are sampled for points in the frame of their camera; OUTSIDE for points behind it."""
    is_in_front = points[..., 2] > least_depth
    uv = to_image(points, intrinsics, is_in_front).clamp(-OUTSIDE, OUTSIDE)
    return torch.where(is_in_front[..., None], uv, OUTSIDE)


def pixel_rays(cameras: Cameras, height: int, width: int) -> Float[Tensor, "*batch view height width 3"]:
    """Return the direction through each pixel centre in the camera frame, of z = 1: times a depth, the point there."""
    device, dtype = cameras.intrinsics.device, cameras.intrinsics.dtype
    v, u = torch.meshgrid(
        (torch.arange(height, device=device, dtype=dtype) + 0.5) / height,
        (torch.arange(width, device=device, dtype=dtype) + 0.5) / width,
        indexing="ij",
    )
    return rays_through(cameras, torch.stack((u, v), dim=-1).expand(*cameras.intrinsics.shape[:-2], -1, -1, -1))


def rays_through(
    cameras: Cameras, uv: Float[Tensor, "*batch view height width 2"]
) -> Float[Tensor, "*batch view height width 3"]:
    """Return the direction through each normalised image position in the camera frame, scaled to z = 1."""
    focal = torch.stack((cameras.intrinsics[..., 0, 0], cameras.intrinsics[..., 1, 1]), dim=-1)
    centre = cameras.intrinsics[..., :2, 2]
    xy = (uv - rearrange(centre, "... view xy -> ... view 1 1 xy")) / rearrange(focal, "... view xy -> ... view 1 1 xy")
    return torch.cat((xy, torch.ones_like(xy[..., :1])), dim=-1)


def camera_to_world_points(
    cameras: Cameras, points: Float[Tensor, "*batch view height width 3"]
) -> Float[Tensor, "*batch view height width 3"]:
    """Transform points from the frame of their camera to the world frame."""
    rotation, translation = cameras.extrinsics[..., :3, :3], cameras.extrinsics[..., None, :3, 3]
    world = points.flatten(-3, -2) @ rotation.transpose(-1, -2) + translation
    return world.view_as(points)


def depth_from_relative_disparity(
    relative: Float[Tensor, "*batch view height width"], cameras: Cameras
) -> Float[Tensor, "*batch view height width"]:
    """Return depth in scene units, at most 2 far; relative disparities below 0 are depths beyond far."""
    farthest = rearrange(1.0 / cameras.far, "... -> ... 1 1 1")
    nearest = rearrange(1.0 / cameras.near, "... -> ... 1 1 1")
    return 1.0 / (farthest + relative * (nearest - farthest)).clamp_min(0.5 * farthest)


def relative_disparity_from_depth(
    depth: Float[Tensor, "*batch view height width"], cameras: Cameras
) -> Float[Tensor, "*batch view height width"]:
    """Invert `depth_from_relative_disparity`, without its clamp. depth: in scene units."""
    farthest = rearrange(1.0 / cameras.far, "... -> ... 1 1 1")
    nearest = rearrange(1.0 / cameras.near, "... -> ... 1 1 1")
    return (1.0 / depth - farthest) / (nearest - farthest)


def cameras_between(cameras: Cameras) -> Cameras | None:
    """Return the cameras midway between each camera and its nearest neighbour; None if there are none.

    Neighbours are cameras whose optical axes differ by less than 90 degrees. The rotation is the one nearest to the
    mean of the two matrices (Moakher, "Means and Averaging in the Group of Rotations", 2002). Intrinsics are those of
    the first camera.
    """
    poses = [_midway(cameras.extrinsics[first], cameras.extrinsics[second]) for first, second in _neighbours(cameras)]
    if not poses:
        return None
    return Cameras(torch.stack(poses), cameras.intrinsics[:1].expand(len(poses), -1, -1), cameras.near, cameras.far)


def _neighbours(cameras: Cameras) -> list[tuple[int, int]]:
    """Return the pairs of a camera and the nearest one whose optical axis is within 90 degrees, each pair once."""
    centres, forward = cameras.extrinsics[:, :3, 3], cameras.extrinsics[:, :3, 2]
    distance = torch.cdist(centres, centres)
    distance[(forward @ forward.T <= 0) | (distance <= 1e-6 * distance.max())] = torch.inf
    pairs = {
        (min(view, other), max(view, other))
        for view, other in enumerate(distance.argmin(dim=1).tolist())
        if distance[view, other].isfinite()
    }
    return sorted(pairs)


def _midway(first: Float[Tensor, "4 4"], second: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    pose = 0.5 * first + 0.5 * second
    left, _, right = torch.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    return pose
