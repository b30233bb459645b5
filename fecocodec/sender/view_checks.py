"""Check views before anything is computed from them."""

from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.limits import MAX_SIDE, MAX_STAGES, MAX_VIEWS, MIN_SIDE
from fecocodec.sender.coverage import LEAST_OPACITY


def check_views(views: Views, num_stages: int) -> None:
    """Raise InputError for views or a number of stages that cannot be encoded."""
    count, (height, width) = len(views.images), views.image_size
    if not 1 <= count <= MAX_VIEWS:
        raise InputError(f"{count} views were given; give 1 to {MAX_VIEWS}, chosen by `views`.")
    if views.cameras.num_views != count:
        raise InputError(f"{count} images were given with {views.cameras.num_views} cameras; give one camera an image.")
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise InputError(f"views are {width}x{height} pixels; sides must be {MIN_SIDE} to {MAX_SIDE}; change `size`.")
    if not 1 <= num_stages <= MAX_STAGES:
        raise InputError(f"{num_stages} stages were asked for; choose 1 or 2.")
    if not bool(views.images.isfinite().all()):
        raise InputError("a view holds values that are not finite; check the images.")
    if views.alpha is not None:
        _check_alpha(views.alpha, (count, height, width))
    if views.ignored is not None:
        _check_ignored(views.ignored, views.names)


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
