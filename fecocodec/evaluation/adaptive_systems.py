"""The adaptive sender as a system, and the same streams with all their Gaussians."""

from dataclasses import replace
from functools import partial

from fecocodec.container import read_stream, write_stream
from fecocodec.evaluation.codec_systems import stream_system
from fecocodec.evaluation.reconstruction import System
from fecocodec.geometry.views import Views
from fecocodec.sender.adaptive import AtLambda, encode_adaptively_with
from fecocodec.sender.encode import Profile

ADAPTIVE, ALL_GAUSSIANS = "adaptive", "adaptive, all Gaussians"


def adaptive_system(profile: Profile, lmbda: float) -> System:
    """Stage 2 of the views it pays for, without the Gaussians that nobody would miss."""
    return stream_system(profile, ADAPTIVE, f"lambda {lmbda:g}", partial(_encode, profile, lmbda))


def all_gaussians_system(profile: Profile, lmbda: float) -> System:
    """The same without its keep section: the difference is what leaving Gaussians out saves and costs."""
    return stream_system(profile, ALL_GAUSSIANS, f"lambda {lmbda:g}", partial(_encode_without_keep, profile, lmbda))


def _encode(profile: Profile, lmbda: float, views: Views) -> bytes:
    return encode_adaptively_with(profile, views, AtLambda(lmbda))


def _encode_without_keep(profile: Profile, lmbda: float, views: Views) -> bytes:
    return write_stream(replace(read_stream(_encode(profile, lmbda, views)), keep=None))
