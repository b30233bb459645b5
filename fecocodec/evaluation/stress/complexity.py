"""Bytes and Gaussians of rooms from blank walls to crowded ones, as the adaptive sender codes them."""

from dataclasses import dataclass
from functools import partial

from fecocodec.container import read_stream
from fecocodec.evaluation.stress.box_room import Room, blank, photograph, waves
from fecocodec.evaluation.stress.camera_paths import sideways
from fecocodec.evaluation.systems.image_codecs import encode_image
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.sender.adaptive import AtLambda, encode_adaptively_with
from fecocodec.sender.encode import Profile

LAMBDA = 1e-3


@dataclass(frozen=True)
class Need:
    """What one room takes. num_waves: patterns laid over each other on its walls, 0: one grey a wall.

    photograph_kib: of its context views as JPEG XL at distance 1, our measure of complexity.
    gaussians_per_pixel: of a context view.
    """

    num_waves: int
    photograph_kib: float
    kib: float
    gaussians_per_pixel: float
    num_stages: int


def measure_need(profile: Profile, num_waves: int, side: int) -> Need:
    """Two square views of the room with so many patterns."""
    paint = partial(waves, count=num_waves) if num_waves else blank
    views = photograph(Room(paint), sideways(), (side, side)).select([0, 1])
    stream = read_stream(data := encode_adaptively_with(profile, views, AtLambda(LAMBDA)))
    density = decode_with(profile.receiver, data).gaussians.count / (2 * side * side)
    return Need(num_waves, photograph_kib(views), len(data) / 1024, density, stream.header.num_stages)


def photograph_kib(views: Views) -> float:
    """KiB of the views as good photographs: how much there is to see."""
    files = [encode_image(image, "JPEG XL", 1.0) for image in views.images]
    return sum(map(len, files)) / 1024
