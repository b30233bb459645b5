"""Baseline that transmits compressed context views; the receiver runs our networks without coding."""

from dataclasses import replace
from functools import partial
from time import perf_counter

import torch

from fecocodec.coding.camera_packing import pack
from fecocodec.container.cameras import pack_cameras
from fecocodec.evaluation.systems.codec import rendered
from fecocodec.evaluation.systems.image_codecs import QUALITY_LADDERS, decode_image, encode_image
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.optimisation_config import DEFAULT, FAST, OptimisationConfig

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


def _reconstruct(
    codec: Codec, image_codec: str, quality: float, config: OptimisationConfig, views: Views, num_context: int
) -> Reconstruction:
    context = views.select(list(range(num_context)))
    begin = perf_counter()
    files = [encode_image(image, image_codec, quality) for image in context.images]
    cameras = pack_cameras(pack(context.cameras))
    encoded = perf_counter()
    received = replace(context, images=torch.stack([decode_image(file, image_codec) for file in files]))
    gaussians = uncoded_gaussians(codec, received, config)
    decoded = perf_counter()
    num_bytes = sum(map(len, files)) + len(cameras)
    return rendered(gaussians, views, num_bytes, encoded - begin, decoded - encoded)
