"""The alternative of sending Gaussians: those of the uncoded networks in the file formats of splat viewers."""

from functools import partial
from time import perf_counter

from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.gaussian_codecs import GAUSSIAN_FORMATS, decode_gaussians, encode_gaussians
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.encode import Profile
from fecocodec.sender.refinement import MOST_DEFAULT_STEPS


def gaussian_systems(profile: Profile) -> tuple[System, ...]:
    """One system a format, refined as the encoder refines; PLY loses nothing and is the ceiling of what is coded."""
    return tuple(System(form, "uncoded networks", partial(_reconstruct, profile, form)) for form in GAUSSIAN_FORMATS)


def _reconstruct(profile: Profile, form: str, views: Views, num_context: int) -> Reconstruction:
    begin = perf_counter()
    context = views.select(list(range(num_context)))
    data = encode_gaussians(uncoded_gaussians(profile, context, MOST_DEFAULT_STEPS), form)
    encoded = perf_counter()
    gaussians = decode_gaussians(data, form)
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)
