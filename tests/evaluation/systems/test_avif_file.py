"""AVIF images of a scene in one file: what is counted is decodable by any AVIF decoder."""

from dataclasses import replace
from io import BytesIO

import imagecodecs
import numpy as np
import pytest
import torch
from PIL import Image

from fecocodec.errors import InputError
from fecocodec.evaluation.systems.avif_file import av1_payload, avif_around, pack_avif, unpack_avif
from fecocodec.evaluation.systems.image_compression import decode_image, encode_image, pack_images, unpack_images
from tests.example_scenes import example_views

CAMERAS = b"the camera section"


@pytest.mark.parametrize(("height", "width"), [(64, 96), (256, 448), (1024, 1024), (65, 77)])
def test_a_container_built_again_decodes_to_the_same_pixels(height: int, width: int) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (height // 8 + 1, width // 8 + 1, 3), np.uint8)
    pixels = np.ascontiguousarray(noise.repeat(8, 0).repeat(8, 1)[:height, :width])
    original = imagecodecs.avif_encode(pixels, level=30, speed=10, pixelformat="420", numthreads=1)
    again = avif_around(av1_payload(original), height, width)
    assert np.array_equal(imagecodecs.avif_decode(again), imagecodecs.avif_decode(original))
    assert np.abs(imagecodecs.avif_decode(again).astype(int) - pixels).mean() < 40
    of_pillow = Image.open(BytesIO(again))
    assert of_pillow.format == "AVIF" and of_pillow.size == (width, height)
    assert np.array_equal(np.asarray(of_pillow), np.asarray(Image.open(BytesIO(original))))


@pytest.mark.parametrize("count", [1, 3])
def test_a_scene_is_its_payloads_its_cameras_and_a_few_bytes(count: int) -> None:
    images = [encode_image(image, "AVIF", 30.0) for image in example_views(count, 64, 96).images]
    data = pack_avif(images, (64, 96), CAMERAS)
    assert len(data) <= sum(len(av1_payload(image)) for image in images) + len(CAMERAS) + 3 + 2 * count
    assert sum(map(len, images)) - len(data) > 270 * count - len(CAMERAS) - 10
    found, size, cameras = unpack_avif(data)
    assert size == (64, 96) and cameras == CAMERAS
    for mine, theirs in zip(found, images, strict=True):
        assert torch.equal(decode_image(mine, "AVIF"), decode_image(theirs, "AVIF"))


def test_a_cut_scene_and_other_images_are_refused() -> None:
    images = [encode_image(image, "AVIF", 30.0) for image in example_views(2, 64, 96).images]
    data = pack_avif(images, (64, 96), CAMERAS)
    for kept in (0, 2, 6, 20):
        with pytest.raises(InputError, match=r"AVIF scene: not a file of `pack_avif`; encode the images again\."):
            unpack_avif(data[:kept])
    with pytest.raises(InputError, match=r"AVIF scene: an image has no media data; encode it as AVIF\."):
        pack_avif([b"no boxes at all"], (64, 96), CAMERAS)


@pytest.mark.parametrize("codec", ["AVIF", "JPEG"])
def test_the_receiver_has_the_cameras_and_the_decoded_photographs(codec: str) -> None:
    views = example_views(2, 64, 96)
    files = pack_images(views, codec, 40.0)
    assert len(files) == (1 if codec == "AVIF" else 3)
    found = unpack_images(files, codec, replace(views, images=0 * views.images, cameras=views.cameras.select([1, 0])))
    torch.testing.assert_close(found.cameras.extrinsics, views.cameras.extrinsics)
    torch.testing.assert_close(found.cameras.intrinsics, views.cameras.intrinsics)
    expected = torch.stack([decode_image(encode_image(image, codec, 40.0), codec) for image in views.images])
    assert torch.equal(found.images, expected)
