"""Gaussians and cameras as NumPy arrays: what the writers of output files read. No torch."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from fecocodec.errors import OutputError
from fecocodec.geometry.gaussian_arrays import GaussianArrays, shape_problem
from fecocodec.geometry.harmonics import rotated_harmonics
from fecocodec.splat_files.output_formats import SpzVersion

OPACITY_MARGIN = 1e-6  # opacities 0 and 1 have no finite logit; they are stored this far inside
RDF_TO_RUB = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenCV axes (right, down, forward) to OpenGL axes (right, up, backward)


@dataclass(frozen=True)
class OutputGaussians(GaussianArrays):
    """Gaussians in float64, in the parametrisations of output files."""

    @property
    def sh_degree(self) -> int:
        return int(np.sqrt(self.harmonics.shape[1])) - 1

    @property
    def log_scales(self) -> Float[np.ndarray, "n 3"]:
        return np.log(self.scales)

    @property
    def logits(self) -> Float[np.ndarray, " n"]:
        """Return the logits of the opacities, finite also for 0 and 1."""
        inside = np.clip(self.opacities, OPACITY_MARGIN, 1 - OPACITY_MARGIN)
        return np.log(inside) - np.log1p(-inside)

    def ordered(self, order: Int[np.ndarray, " n"]) -> "OutputGaussians":
        """Return the Gaussians in another order."""
        return OutputGaussians(*(field[order] for field in self.fields()))

    def padded(self, sh_degree: int) -> "OutputGaussians":
        """Return the Gaussians with harmonics up to this degree, zeros above their own. They look the same."""
        missing = max(0, (sh_degree + 1) ** 2 - self.harmonics.shape[1])
        return replace(self, harmonics=np.pad(self.harmonics, ((0, 0), (0, missing), (0, 0))))

    def transformed(self, pose: Float[np.ndarray, "4 4"]) -> "OutputGaussians":
        """Return the Gaussians in another frame. pose: rigid transform from the old frame to the new one.

        Raises OutputError for harmonics above degree 2 that are not zero: their rotation is not implemented.
        """
        if self.harmonics[:, 9:].any():
            raise OutputError("the frame of harmonics above degree 2 cannot be changed; write them in their own frame.")
        rotation = pose[:3, :3]
        rotated = rotated_harmonics(self.harmonics[:, 1:9], rotation)
        return OutputGaussians(
            self.means @ rotation.T + pose[:3, 3],
            self.scales,
            _multiply(_quaternion(rotation), self.rotations),
            self.opacities,
            np.concatenate((self.harmonics[:, :1], rotated, self.harmonics[:, 9:]), axis=1),
        )


@dataclass(frozen=True)
class CameraArrays:
    """The coded cameras. extrinsics: camera-to-world, OpenCV axes. intrinsics: normalised by image width and height.

    near, far: bounds of depth in scene units. image_size: (height, width) in pixels.
    """

    extrinsics: Float[np.ndarray, "view 4 4"]
    intrinsics: Float[np.ndarray, "view 3 3"]
    near: float
    far: float
    image_size: tuple[int, int]

    def transformed(self, pose: Float[np.ndarray, "4 4"]) -> "CameraArrays":
        """Return the cameras in another frame. pose: rigid transform from the old frame to the new one."""
        return CameraArrays(pose @ self.extrinsics, self.intrinsics, self.near, self.far, self.image_size)


@dataclass(frozen=True)
class OutputScene:
    """What an output file is written from, in the frame of the PLY file (RDF axes).

    cameras: None if they are not known. name: of the scene, for formats that show one. place: beginning of the message
    if the format cannot hold the scene. spz_version: for SPZ files.
    """

    gaussians: OutputGaussians
    cameras: CameraArrays | None
    name: str
    place: str
    spz_version: SpzVersion = 3


def gaussian_arrays(gaussians: Any, place: str) -> OutputGaussians:
    """Convert Gaussians whose fields are CPU tensors or arrays, and check that files can represent them.

    Raises OutputError, which begins with `place`, if a value is not finite in float32 or out of range.
    """
    arrays = OutputGaussians(*(_float64(field) for field in gaussians.fields()))
    if problem := shape_problem(arrays):
        raise OutputError(f"{place}: {problem}")
    require_values(place, "opacities", "in [0, 1]", (arrays.opacities >= 0) & (arrays.opacities <= 1))
    require_values(place, "scales", "above 0", arrays.scales > 0)
    with np.errstate(over="ignore"):
        for field in arrays.fields():
            require_values(place, "values", "finite in float32", np.isfinite(field.astype(np.float32)))
    return arrays


def camera_arrays(cameras: Any, image_size: tuple[int, int]) -> CameraArrays:
    """Convert cameras whose fields are CPU tensors or arrays. image_size: (height, width) in pixels."""
    extrinsics, intrinsics, near, far = (_float64(field) for field in cameras.fields())
    return CameraArrays(extrinsics, intrinsics, float(near), float(far), image_size)


def require_values(place: str, what: str, demand: str, is_good: Bool[np.ndarray, "n *rest"]) -> None:
    """Raise OutputError for the first Gaussian that is not good. Comparisons with NaN are false, so NaN is rejected."""
    if not is_good.all():
        first = int(np.argwhere(~is_good)[0, 0])
        raise OutputError(
            f"{place}: Gaussian {first} has {what} not {demand}; nothing was written, check their source."
        )


def without_largest(
    quaternions: Float[np.ndarray, "n 4"],
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Return the index of the largest component of each unit quaternion, and the other three in their order.

    The sign is chosen such that the largest component is positive, so the three determine it ("smallest three").
    """
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    largest = np.abs(unit).argmax(axis=1)
    unit = unit * np.where(np.take_along_axis(unit, largest[:, None], axis=1) < 0, -1.0, 1.0)
    is_kept = np.arange(4) != largest[:, None]
    return largest, unit[is_kept].reshape(-1, 3)


def _float64(field: Any) -> np.ndarray:
    return np.asarray(field.detach() if hasattr(field, "detach") else field, dtype=np.float64)


def _quaternion(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 4"]:
    """Return the unit quaternion wxyz of a rotation matrix: the leading eigenvector of Bar-Itzhack's matrix (2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    matrix = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    return np.linalg.eigh(matrix)[1][:, -1]


def _multiply(first: Float[np.ndarray, " 4"], second: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Return the quaternion products wxyz `first * second`, which rotate by `second` and then by `first`."""
    w, x, y, z = first
    return second @ np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]).T
