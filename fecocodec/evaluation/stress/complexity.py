"""File size and number of Gaussians of synthetic rooms, from blank walls to many superimposed patterns."""

from dataclasses import dataclass
from functools import partial

from fecocodec.container import quantise_lambda
from fecocodec.evaluation.stress.box_room import Room, blank, photograph, waves
from fecocodec.evaluation.stress.camera_paths import sideways
from fecocodec.evaluation.systems.image_codecs import encode_image
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import encode_with

LAMBDA = 1e-3


@dataclass(frozen=True)
class Need:
    """Size of one coded room. num_waves: number of superimposed patterns on its walls, 0 for one grey per wall.

    photograph_kib: size of the context views as JPEG XL at distance 1, the measure of complexity. kib: size of the
    coded file. gaussians_per_pixel: number of Gaussians per pixel of the context views.
    """

    num_waves: int
    photograph_kib: float
    kib: float
    gaussians_per_pixel: float


def measure_need(codec: Codec, num_waves: int, side: int) -> Need:
    """Encode and decode two square views of the room with `num_waves` patterns. side: image side in pixels."""
    paint = partial(waves, count=num_waves) if num_waves else blank
    views = photograph(Room(paint), sideways(), (side, side)).select([0, 1])
    data = encode_with(codec, views, quantise_lambda(LAMBDA))
    density = decode_with(codec.receiver, data).gaussians.count / (2 * side * side)
    return Need(num_waves, photograph_kib(views), len(data) / 1024, density)


def photograph_kib(views: Views) -> float:
    """Return the size of the views in KiB as JPEG XL at distance 1. Raises InputError if imagecodecs is missing."""
    files = [encode_image(image, "JPEG XL", 1.0) for image in views.images]
    return sum(map(len, files)) / 1024
