"""Baseline that transmits compressed context views; the receiver runs our networks without coding.

Formats are JPEG, AVIF and JPEG XL, by imagecodecs. AVIF is encoded at its slowest speed, and counted without its
containers (`avif_file.py`).
"""

from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.container.cameras import pack_cameras, unpack_cameras
from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.systems.avif_file import pack_avif, unpack_avif
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import DEFAULT, FAST, OptimisationConfig

# From the lowest quality of each codec to about 2 bits per pixel for a photograph of 256x256 pixels.
QUALITY_LADDERS: dict[str, tuple[float, ...]] = {
    "JPEG XL": (15.0, 8.0, 4.0, 2.0, 1.0),
    "AVIF": (2.0, 12.0, 30.0, 50.0, 75.0, 85.0),
    "JPEG": (2.0, 6.0, 15.0, 40.0, 75.0),
}


JPEG_XL = "JPEG XL"
JPEG_XL_DISTANCES = (0.1, 25.0)  # the finest that is searched, and the coarsest that there is
_NUM_HALVINGS = 10


def encode_image(image: Float[Tensor, "3 height width"], codec: str, quality: float) -> bytes:
    """Encode one image. image: sRGB in [0, 1]. codec: a key of QUALITY_LADDERS.

    quality: for JPEG XL the Butteraugli distance, smaller is better; for the others 0 to 100, larger is better.
    Raises InputError if imagecodecs is not installed.
    """
    library = require_extra("imagecodecs", f"coding images as {codec}")
    pixels = np.ascontiguousarray(rearrange((image.clamp(0, 1) * 255).round().byte().numpy(), "rgb h w -> h w rgb"))
    if codec == "JPEG XL":
        return bytes(library.jpegxl_encode(pixels, distance=quality, effort=7))
    if codec == "AVIF":
        return bytes(library.avif_encode(pixels, level=int(quality), speed=0, pixelformat="420", numthreads=1))
    return bytes(library.jpeg8_encode(pixels, level=int(quality), subsampling="420", optimize=True))


def decode_image(data: bytes, codec: str) -> Float[Tensor, "3 height width"]:
    """Decode the bytes of `encode_image` to sRGB in [0, 1]. Raises InputError if imagecodecs is not installed."""
    library = require_extra("imagecodecs", f"decoding {codec}")
    decoders = {
        "JPEG XL": library.jpegxl_decode,
        "AVIF": library.avif_decode,
        "JPEG": library.jpeg8_decode,
    }
    pixels = np.asarray(decoders[codec](data))[..., :3]
    return torch.from_numpy(rearrange(pixels, "h w rgb -> rgb h w").astype(np.float32) / 255)


OPTIMISED = "AVIF"


def image_systems(codec: Codec) -> tuple[System, ...]:
    """Return one system per image codec and quality. Their receiver also needs the networks of the sender.

    With `OPTIMISED`, there is a second system whose receiver also optimises the latents towards the decoded
    photographs.
    """
    ladders = [(name, name, ladder, FAST) for name, ladder in QUALITY_LADDERS.items()]
    ladders.append((f"{OPTIMISED}, optimised at the receiver", OPTIMISED, QUALITY_LADDERS[OPTIMISED], DEFAULT))
    return tuple(
        System(name, f"quality {quality:g}", partial(_reconstruct, codec, image_codec, quality, config))
        for name, image_codec, ladder, config in ladders
        for quality in ladder
    )


def pack_images(context: Views, image_codec: str, quality: float) -> tuple[bytes, ...]:
    """Encode context views: files to transmit, the camera section last; for AVIF one file with both."""
    files = [encode_image(image, image_codec, quality) for image in context.images]
    cameras = pack_cameras(pack(context.cameras))
    return (pack_avif(files, context.image_size, cameras),) if image_codec == "AVIF" else (*files, cameras)


def unpack_images(files: tuple[bytes, ...], image_codec: str, context: Views) -> Views:
    """Decode the files of `pack_images` to views. context: supplies what is not transmitted, such as names."""
    *images, cameras = files
    if image_codec == "AVIF":
        images, _, cameras = unpack_avif(files[0])
    return replace(
        context,
        images=torch.stack([decode_image(image, image_codec) for image in images]),
        cameras=unpack(unpack_cameras(cameras, len(images), "compressed photographs")),
    )


def reconstruct_at(codec: Codec, num_bytes: int, views: Views, num_context: int) -> Reconstruction:
    """Return the reconstruction from JPEG XL whose size, cameras included, is nearest to `num_bytes`."""
    distance = jpeg_xl_distance(views.select(list(range(num_context))), num_bytes)
    return _reconstruct(codec, JPEG_XL, distance, FAST, views, num_context)


def jpeg_xl_distance(context: Views, num_bytes: int) -> float:
    """Return the Butteraugli distance at which the files of `pack_images` have nearly `num_bytes` in all."""
    fine, coarse = JPEG_XL_DISTANCES
    found: list[tuple[int, float]] = []
    for _ in range(_NUM_HALVINGS):
        distance = (fine * coarse) ** 0.5
        size = sum(map(len, pack_images(context, JPEG_XL, distance)))
        found.append((abs(size - num_bytes), distance))
        fine, coarse = (distance, coarse) if size > num_bytes else (fine, distance)
    return min(found)[1]


def _reconstruct(
    codec: Codec, image_codec: str, quality: float, config: OptimisationConfig, views: Views, num_context: int
) -> Reconstruction:
    context = views.select(list(range(num_context)))
    begin = perf_counter()
    files = pack_images(context, image_codec, quality)
    encoded = perf_counter()
    gaussians = uncoded_gaussians(codec, unpack_images(files, image_codec, context), config)
    decoded = perf_counter()
    return rendered(gaussians, views, sum(map(len, files)), encoded - begin, decoded - encoded)
