"""The adaptive sender as a system, and the same streams with all their Gaussians."""

from dataclasses import replace
from functools import partial
from time import perf_counter

from fecocodec.container import read_stream, write_stream
from fecocodec.evaluation.systems.codec import rendered, stream_system
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.rendering.pruning import prune
from fecocodec.sender.adaptive import AtLambda, encode_adaptively_with
from fecocodec.sender.encode import Profile

ADAPTIVE, ALL_GAUSSIANS, PRUNED = "adaptive", "adaptive, all Gaussians", "adaptive, pruned"


def adaptive_system(profile: Profile, lmbda: float) -> System:
    """Stage 2 of the views it pays for, without the Gaussians that nobody would miss."""
    return stream_system(profile, ADAPTIVE, f"lambda {lmbda:g}", partial(_encode, profile, lmbda))


def all_gaussians_system(profile: Profile, lmbda: float) -> System:
    """The same without its keep section: the difference is what leaving Gaussians out saves and costs."""
    return stream_system(profile, ALL_GAUSSIANS, f"lambda {lmbda:g}", partial(_encode_without_keep, profile, lmbda))


def pruned_system(profile: Profile, lmbda: float) -> System:
    """The adaptive streams, decoded without what no picture near the context cameras would miss (`decode --prune`)."""
    return System(PRUNED, f"lambda {lmbda:g}", partial(_pruned, profile, lmbda))


def _pruned(profile: Profile, lmbda: float, views: Views, num_context: int) -> Reconstruction:
    found = adaptive_system(profile, lmbda).reconstruct(views, num_context)
    assert found.gaussians is not None  # a stream always has some
    begin = perf_counter()
    kept = prune(found.gaussians, views.cameras.select(list(range(num_context))), views.image_size)
    seconds = found.decode_seconds + perf_counter() - begin
    return rendered(kept, views, found.num_bytes, found.encode_seconds, seconds)


def _encode(profile: Profile, lmbda: float, views: Views) -> bytes:
    return encode_adaptively_with(profile, views, AtLambda(lmbda))


def _encode_without_keep(profile: Profile, lmbda: float, views: Views) -> bytes:
    return write_stream(replace(read_stream(_encode(profile, lmbda, views)), keep=None))
