"""Input of the networks: photographs on the coding grid, and the cameras as the receiver will decode them."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.container import PackedCameras
from fecocodec.container.camera_validation import check_cameras
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.coding_grid import resample_to_grid
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class Scene:
    """One scene on the networks' device.

    packed: cameras as stored in the stream. cameras: the same cameras, normalised, as a batch of one scene. images:
    sRGB in [0, 1], on the coding grid, as a batch of one scene. image_size: (height, width) of the input views in
    pixels. alpha: opacity of the input views in [0, 1], at `image_size`; None for opaque views.
    """

    packed: PackedCameras
    cameras: Cameras
    images: Float[Tensor, "1 view 3 h w"]
    image_size: tuple[int, int]
    alpha: Float[Tensor, "view height width"] | None

    @property
    def num_views(self) -> int:
        """Number of context views."""
        return self.images.shape[1]


def prepare_scene(views: Views, device: torch.device) -> Scene:
    """Pack and normalise the cameras, and resample the images to the coding grid.

    Raises InputError for cameras that a stream cannot represent.
    """
    packed = _pack_checked(views.cameras)
    normalised, _ = normalise_scene(unpack(packed))
    images = resample_to_grid(views.images.float().clone()).to(device)
    return Scene(packed, normalised.to(device).as_batch(), images[None], views.image_size, views.alpha)


def _pack_checked(cameras: Cameras) -> PackedCameras:
    packed = pack(cameras)
    try:
        check_cameras(packed, "the views' cameras")
    except BitstreamError as error:
        raise InputError(str(error)) from error
    return packed
