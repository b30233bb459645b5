"""Input of the networks: photographs on the coding grid, and the cameras as the receiver will decode them."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.container import PackedCameras
from fecocodec.container.camera_validation import check_cameras
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.coding_grid import filled, ignored_on_grid, resample_to_grid
from fecocodec.geometry.normalisation import normalise_scene, normalised_extrinsics
from fecocodec.geometry.views import Views


@dataclass(frozen=True)
class Guides:
    """Photographs of a scene that are not coded, on the device and in the frame of the coded ones.

    images: sRGB in [0, 1], on the coding grid; of cut-outs on white. transparency: 1 - opacity of cut-outs, on the
    grid; None for opaque guides. ignored: pixels that masks mark, on the grid; None without masks.
    """

    images: Float[Tensor, "guide 3 h w"]
    cameras: Cameras
    transparency: Float[Tensor, "guide 1 h w"] | None = None
    ignored: Bool[Tensor, "guide h w"] | None = None

    @property
    def count(self) -> int:
        return len(self.images)

    def select(self, guides: list[int]) -> "Guides":
        transparency = None if self.transparency is None else self.transparency[guides]
        ignored = None if self.ignored is None else self.ignored[guides]
        return Guides(self.images[guides], self.cameras.select(guides), transparency, ignored)


@dataclass(frozen=True)
class Scene:
    """One scene on the networks' device.

    packed: cameras as stored in the stream. cameras: the same cameras, normalised, as a batch of one scene. images:
    sRGB in [0, 1], on the coding grid, as a batch of one scene. image_size: (height, width) of the input views in
    pixels. alpha: opacity of the input views in [0, 1], at `image_size`; None for opaque views. guides: photographs
    that are not coded; None for none. ignored: pixels that masks mark, on the grid; None without masks.
    """

    packed: PackedCameras
    cameras: Cameras
    images: Float[Tensor, "1 view 3 h w"]
    image_size: tuple[int, int]
    alpha: Float[Tensor, "view height width"] | None
    guides: Guides | None = None
    ignored: Bool[Tensor, "view h w"] | None = None

    @property
    def num_views(self) -> int:
        return self.images.shape[1]

    @property
    def num_guides(self) -> int:
        return 0 if self.guides is None else self.guides.count


def prepare_scene(views: Views, device: torch.device, guides: Views | None = None) -> Scene:
    """Pack and normalise the cameras, and resample the images to the coding grid.

    guides: of the same image size, with cameras in the same world frame. Raises InputError for cameras that a stream
    cannot represent.
    """
    packed = pack(views.cameras)
    try:
        check_cameras(packed, "the views' cameras")
    except BitstreamError as error:
        raise InputError(str(error)) from error
    normalised, frame = normalise_scene(unpack(packed))
    images, ignored = _on_grid(views, device)
    of_scene = packed, normalised.to(device).as_batch(), images[None], views.image_size, views.alpha
    scene = Scene(*of_scene, ignored=ignored)
    if guides is None or len(guides.images) == 0:
        return scene
    extrinsics = normalised_extrinsics(guides.cameras.extrinsics, frame)
    cameras = Cameras(extrinsics, guides.cameras.intrinsics, normalised.near, normalised.far).to(device)
    taught, ignored = _on_grid(guides, device)
    alpha = guides.alpha
    transparency = None if alpha is None else 1.0 - resample_to_grid(alpha[:, None].float()).to(device)
    return replace(scene, guides=Guides(taught, cameras, transparency, ignored))


def _on_grid(views: Views, device: torch.device) -> tuple[Float[Tensor, "view 3 h w"], Bool[Tensor, "view h w"] | None]:
    """Return the images and their ignored pixels, which are filled from around them, on the coding grid."""
    images, ignored = filled(views.images.float(), views.ignored), ignored_on_grid(views.ignored)
    return resample_to_grid(images.clone()).to(device), None if ignored is None else ignored.to(device)
