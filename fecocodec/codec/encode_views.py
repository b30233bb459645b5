"""Encode the views of a folder as its options say."""

from functools import partial

from fecocodec.codec.messages import Messages
from fecocodec.codec.options import EncodingOptions
from fecocodec.container import with_metadata
from fecocodec.errors import InputError, error_context
from fecocodec.geometry.views import Views
from fecocodec.progress import OnProgress
from fecocodec.sender.encode import encode
from fecocodec.sender.input_warnings import check_input
from fecocodec.sender.rate_control import encode_to_target


def encode_views(
    views: Views,
    guides: Views | None,
    checks: Views | None,
    options: EncodingOptions,
    messages: Messages,
    on_progress: OnProgress,
) -> bytes:
    """Return the bytes of the file. checks: choose lambda for a PSNR of new views, else nothing. Raises InputError."""
    messages.warn(*check_input(views, options.effort, guides))
    if options.target is None:
        coder = partial(encode, lmbda=options.lmbda, num_stages=options.num_stages)
    else:
        coder = partial(encode_to_target, target=options.target, checks=checks)
    with error_context(messages.path, (InputError,)):
        data = coder(
            views,
            guides=guides,
            effort=options.effort,
            sharpness=options.sharpness,
            device=options.device,
            model=options.model,
            on_progress=on_progress,
            on_warning=messages.warn,
            on_omission=messages.omit,
        )
    return with_metadata(data, options.metadata) if options.metadata else data
