"""Baseline that transmits Gaussians, predicted without coding, in the file formats of splat viewers."""

from functools import partial
from time import perf_counter

from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.gaussian_codecs import GAUSSIAN_FORMATS, decode_gaussians, encode_gaussians
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import DEFAULT


def gaussian_systems(codec: Codec) -> tuple[System, ...]:
    """Return one system per format, with the default latent optimisation. PLY is lossless: an upper bound."""
    return tuple(System(form, "uncoded networks", partial(_reconstruct, codec, form)) for form in GAUSSIAN_FORMATS)


def _reconstruct(codec: Codec, form: str, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    context = views.select(list(range(num_context)))
    data = encode_gaussians(uncoded_gaussians(codec, context, DEFAULT), form)
    encoded = perf_counter()
    gaussians = decode_gaussians(data, form)
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)
