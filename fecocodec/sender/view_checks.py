"""Check views before anything is computed from them."""

from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.limits import MAX_SIDE, MAX_STAGES, MAX_VIEWS, MIN_SIDE
from fecocodec.sender.coverage import LEAST_OPACITY

LARGEST_VALUE = 1.5  # of images in [0, 1], with room for what resampling adds; those in [0, 255] have larger ones
LARGEST_CENTRE = 10.0  # of principal points divided by image sides; those in pixels are larger


def check_views(views: Views, num_stages: int, guides: Views | None = None) -> None:
    """Raise InputError for views, guides or a number of stages that cannot be encoded."""
    count, (height, width) = len(views.images), views.image_size
    if not 1 <= count <= MAX_VIEWS:
        raise InputError(f"{count} views were given; give 1 to {MAX_VIEWS}, chosen by `views`.")
    check_photographs(views, "views")
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise InputError(f"views are {width}x{height} pixels; sides must be {MIN_SIDE} to {MAX_SIDE}; change `size`.")
    if not 1 <= num_stages <= MAX_STAGES:
        raise InputError(f"{num_stages} stages were asked for; choose 1 or 2.")
    if views.alpha is not None:
        _check_alpha(views.alpha, (count, height, width))
    if views.ignored is not None:
        _check_ignored(views.ignored, views.names)
    if guides is not None and len(guides.images):
        check_photographs(guides, "guides")
        if guides.image_size != views.image_size:
            of_guides = f"{guides.image_size[1]}x{guides.image_size[0]}"
            raise InputError(f"guides are {of_guides} pixels, and views {width}x{height}; read both at one `size`.")


def check_photographs(views: Views, role: str) -> None:
    """Raise InputError for images or cameras of other shapes, number or units than `Views` has. role: in messages."""
    images, cameras, count = views.images, views.cameras, len(views.images)
    if images.ndim != 4 or images.shape[1] != 3 or not images.is_floating_point():
        raise InputError(
            f"images of the {role} have the shape {tuple(images.shape)} and the type {images.dtype}; give floats in "
            "[0, 1] of the shape (view, 3, height, width)."
        )
    if cameras.num_views != count or len(views.names) != count:
        raise InputError(
            f"{count} images of the {role} were given with {cameras.num_views} cameras and {len(views.names)} names; "
            "give one camera and one name an image."
        )
    if tuple(cameras.extrinsics.shape) != (count, 4, 4) or tuple(cameras.intrinsics.shape) != (count, 3, 3):
        found = f"{tuple(cameras.extrinsics.shape)} and {tuple(cameras.intrinsics.shape)}"
        raise InputError(f"extrinsics and intrinsics of the {role} have shapes {found}; give 4x4 and 3x3 for each.")
    if not bool(images.isfinite().all()):
        raise InputError(f"images of the {role} hold values that are not finite; check them.")
    if (largest := float(images.abs().amax())) > LARGEST_VALUE:
        raise InputError(f"images of the {role} have values up to {largest:g}; divide them so that they are in [0, 1].")
    if (centre := float(cameras.intrinsics[:, :2, 2].abs().amax())) > LARGEST_CENTRE:
        raise InputError(
            f"a principal point of the {role} is {centre:g} image sides from the corner; divide row 0 of the "
            "intrinsics by image width, and row 1 by image height."
        )


def _check_alpha(alpha: Float[Tensor, "*shape"], shape: tuple[int, int, int]) -> None:
    if tuple(alpha.shape) != shape:
        raise InputError(f"alpha has the shape {tuple(alpha.shape)}, the images need {shape}; give one value a pixel.")
    if not bool(alpha.isfinite().all()):
        raise InputError("alpha holds values that are not finite; check the images.")
    if not bool((alpha >= LEAST_OPACITY).any()):
        raise InputError(
            "every pixel of the views is transparent; correct the images, or ignore their opacity by a `background`."
        )


def _check_ignored(ignored: Bool[Tensor, "view height width"], names: tuple[str, ...]) -> None:
    if (nothing := ignored.flatten(1).all(dim=1)).any():
        name = names[int(nothing.nonzero()[0])]
        raise InputError(
            f"a mask marks every pixel of {name}; leave it out by `views`, correct the mask, or set `masks=unused`."
        )
