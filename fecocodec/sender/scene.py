"""Input of the networks: photographs on the coding grid, and the cameras as the receiver will decode them."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.container import PackedCameras
from fecocodec.container.camera_validation import check_cameras
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.coding_grid import resample_to_grid
from fecocodec.geometry.normalisation import normalise_scene, normalised_extrinsics
from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class Guides:
    """Photographs of a scene that are not coded, on the device and in the frame of the coded ones.

    images: sRGB in [0, 1], on the coding grid; of cut-outs on white. transparency: 1 - opacity of cut-outs, on the
    grid; None for opaque guides.
    """

    images: Float[Tensor, "guide 3 h w"]
    cameras: Cameras
    transparency: Float[Tensor, "guide 1 h w"] | None = None

    @property
    def count(self) -> int:
        return len(self.images)

    def select(self, guides: list[int]) -> "Guides":
        """Return these guides, in this order."""
        transparency = None if self.transparency is None else self.transparency[guides]
        return Guides(self.images[guides], self.cameras.select(guides), transparency)


@dataclass(frozen=True)
class Scene:
    """One scene on the networks' device.

    packed: cameras as stored in the stream. cameras: the same cameras, normalised, as a batch of one scene. images:
    sRGB in [0, 1], on the coding grid, as a batch of one scene. image_size: (height, width) of the input views in
    pixels. alpha: opacity of the input views in [0, 1], at `image_size`; None for opaque views. guides: photographs
    that are not coded; None for none.
    """

    packed: PackedCameras
    cameras: Cameras
    images: Float[Tensor, "1 view 3 h w"]
    image_size: tuple[int, int]
    alpha: Float[Tensor, "view height width"] | None
    guides: Guides | None = None

    @property
    def num_views(self) -> int:
        """Number of context views."""
        return self.images.shape[1]


def prepare_scene(views: Views, device: torch.device, guides: Views | None = None) -> Scene:
    """Pack and normalise the cameras, and resample the images to the coding grid.

    guides: of the same image size, with cameras in the same world frame. Raises InputError for cameras that a stream
    cannot represent.
    """
    packed = _pack_checked(views.cameras)
    normalised, frame = normalise_scene(unpack(packed))
    images = resample_to_grid(views.images.float().clone()).to(device)
    scene = Scene(packed, normalised.to(device).as_batch(), images[None], views.image_size, views.alpha)
    if guides is None or len(guides.images) == 0:
        return scene
    extrinsics = normalised_extrinsics(guides.cameras.extrinsics, frame)
    cameras = Cameras(extrinsics, guides.cameras.intrinsics, normalised.near, normalised.far).to(device)
    taught = resample_to_grid(guides.images.float().clone()).to(device)
    alpha = guides.alpha
    transparency = None if alpha is None else 1.0 - resample_to_grid(alpha[:, None].float()).to(device)
    return replace(scene, guides=Guides(taught, cameras, transparency))


def _pack_checked(cameras: Cameras) -> PackedCameras:
    packed = pack(cameras)
    try:
        check_cameras(packed, "the views' cameras")
    except BitstreamError as error:
        raise InputError(str(error)) from error
    return packed
