"""The decoded scene as NumPy arrays."""

from dataclasses import dataclass

from fecocodec.geometry.gaussian_arrays import GaussianArrays, SceneCameras


@dataclass(frozen=True)
class Decoded:
    """A decoded scene.

    gaussians: in the world frame and unit of length of the cameras. cameras: of the context views.
    image_size: (height, width) of the context views in pixels. stages: number of stages decoded, 1 or 2.
    damage: error message about the rest of the stream, None for an intact stream.
    """

    gaussians: GaussianArrays
    cameras: SceneCameras
    image_size: tuple[int, int]
    stages: int
    damage: str | None
