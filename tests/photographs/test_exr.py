"""OpenEXR holds linear light and depth; checked through OpenEXR's own reader and writer."""

import struct

import numpy as np
import OpenEXR
import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.photographs.exr import ExrImage, linear_to_srgb, read_exr, read_exr_size, srgb_to_linear, write_exr


def store(path, channels, **header) -> None:
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header, channels).write(
        str(path)
    )


def test_colour_is_stored_as_linear_light_and_depth_as_it_is(tmp_path):
    srgb = torch.tensor([0.0, 0.04, 0.5, 1.0]).expand(3, 2, 4).contiguous()
    depth = torch.rand(2, 4) * 10
    write_exr(tmp_path / "image.exr", ExrImage(srgb, depth))
    channels = OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True).channels()
    assert set(channels) == {"R", "G", "B", "Z"}
    expected = [0.0, 0.04 / 12.92, ((0.5 + 0.055) / 1.055) ** 2.4, 1.0]
    np.testing.assert_allclose(channels["G"].pixels[1], expected, rtol=1e-5)
    assert np.array_equal(channels["Z"].pixels, depth.numpy())
    again = read_exr(tmp_path / "image.exr")
    torch.testing.assert_close(again.colour, srgb, atol=1e-6, rtol=0)
    assert torch.equal(again.depth, depth)


def test_the_two_transfer_functions_are_inverse():
    values = torch.linspace(0, 1, 1001)
    torch.testing.assert_close(linear_to_srgb(srgb_to_linear(values)), values, atol=2e-6, rtol=0)
    assert linear_to_srgb(torch.tensor(0.18)).item() == pytest.approx(0.4614, abs=1e-4)  # middle grey


def test_half_floats_bright_light_and_nan(tmp_path):
    light = np.array([[[0.18, 5.0, np.nan]]], np.float16)
    store(tmp_path / "image.exr", {"RGB": np.ascontiguousarray(light)})
    torch.testing.assert_close(
        read_exr(tmp_path / "image.exr").colour[:, 0, 0], torch.tensor([0.4614, 1.0, 0.0]), atol=1e-3, rtol=0
    )


def test_alpha_is_premultiplied_and_shows_white(tmp_path):
    store(tmp_path / "image.exr", {"RGBA": np.full((2, 3, 4), 0.25, np.float32)})
    torch.testing.assert_close(read_exr(tmp_path / "image.exr").colour, torch.ones(3, 2, 3))


def test_luminance_is_grey(tmp_path):
    store(tmp_path / "image.exr", {"Y": np.full((2, 3), 0.18, np.float32)})
    torch.testing.assert_close(
        read_exr(tmp_path / "image.exr").colour, torch.full((3, 2, 3), 0.4614), atol=1e-4, rtol=0
    )
    assert read_exr_size(tmp_path / "image.exr") == (2, 3)


def test_without_colour_it_is_refused(tmp_path):
    path = tmp_path / "image.exr"
    store(path, {"Z": np.ones((2, 3), np.float32)})
    with pytest.raises(InputError) as caught:
        read_exr(path)
    assert str(caught.value) == f"{path}: no colour among the channels ['Z']; store R, G and B."


def with_window(path, width: int, height: int) -> None:
    """Change the size in the header of a stored file; its few pixels stay as they are."""
    data = path.read_bytes()
    mark = b"dataWindow\0box2i\0" + struct.pack("<i", 16)
    start = data.index(mark) + len(mark)
    path.write_bytes(data[:start] + struct.pack("<4i", 0, 0, width - 1, height - 1) + data[start + 16 :])


@pytest.mark.parametrize(("width", "height"), [(8193, 8192), (100_000, 100_000), (70_000_000, 1)])
def test_too_many_pixels_are_refused_before_they_are_decoded(width, height, tmp_path):
    path = tmp_path / "image.exr"
    store(path, {"RGB": np.zeros((2, 3, 3), np.float32)})
    with_window(path, width, height)
    for read in (read_exr, read_exr_size):
        with pytest.raises(InputError, match=r"image\.exr: the image has too many pixels .*; store it smaller\."):
            read(path)


def test_too_many_channels_are_refused_before_they_are_decoded(tmp_path):
    path = tmp_path / "image.exr"
    store(path, {f"layer{number}": np.zeros((2, 3), np.float32) for number in range(20)})
    with_window(path, 4096, 4096)
    with pytest.raises(InputError, match=r"too many channels or parts for its size; store R, G and B alone\."):
        read_exr(path)


def test_opacity_is_returned(tmp_path):
    store(tmp_path / "image.exr", {"RGBA": np.full((2, 3, 4), 0.25, np.float32)})
    torch.testing.assert_close(read_exr(tmp_path / "image.exr").alpha, torch.full((2, 3), 0.25))
