"""The alternative of sending photographs: compressed context views, and our networks, uncoded, at the receiver."""

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
from fecocodec.sender.encode import Profile
from fecocodec.sender.refinement import MOST_DEFAULT_STEPS

REFINED = "AVIF"  # with the steps that the encoder takes by default for a pair at its smallest lambda


def image_systems(profile: Profile) -> tuple[System, ...]:
    """One system a codec and quality. Such a receiver needs the sender's networks too; the others do not.

    A receiver that has all this can also render and refine, towards the photographs as decoded; tried with `REFINED`.
    """
    ladders = [(codec, codec, ladder, 0) for codec, ladder in QUALITY_LADDERS.items()]
    ladders.append((f"{REFINED}, refined at the receiver", REFINED, QUALITY_LADDERS[REFINED], MOST_DEFAULT_STEPS))
    return tuple(
        System(name, f"quality {quality:g}", partial(_reconstruct, profile, codec, quality, steps))
        for name, codec, ladder, steps in ladders
        for quality in ladder
    )


def _reconstruct(
    profile: Profile, codec: str, quality: float, refinement_steps: int, views: Views, num_context: int
) -> Reconstruction:
    context = views.select(list(range(num_context)))
    begin = perf_counter()
    files = [encode_image(image, codec, quality) for image in context.images]
    cameras = pack_cameras(pack(context.cameras))
    encoded = perf_counter()
    received = replace(context, images=torch.stack([decode_image(file, codec) for file in files]))
    gaussians = uncoded_gaussians(profile, received, refinement_steps)
    decoded = perf_counter()
    num_bytes = sum(map(len, files)) + len(cameras)
    return rendered(gaussians, views, num_bytes, encoded - begin, decoded - encoded)
