"""The alternative of sending Gaussians: those of the uncoded networks in the file formats of splat viewers."""

from functools import partial
from time import perf_counter

from fecocodec.evaluation.codec_systems import rendered
from fecocodec.evaluation.gaussian_codecs import GAUSSIAN_FORMATS, decode_gaussians, encode_gaussians
from fecocodec.evaluation.reconstruction import Reconstruction, System
from fecocodec.evaluation.uncoded import uncoded_gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.encode import Profile


def gaussian_systems(profile: Profile) -> tuple[System, ...]:
    """One system a format; PLY loses nothing and is the ceiling of everything that uses these networks."""
    return tuple(System(form, "uncoded networks", partial(_reconstruct, profile, form)) for form in GAUSSIAN_FORMATS)


def _reconstruct(profile: Profile, form: str, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    data = encode_gaussians(uncoded_gaussians(profile, views.select(list(range(num_context)))), form)
    encoded = perf_counter()
    gaussians = decode_gaussians(data, form)
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)
