"""Photographs are read as sRGB in [0, 1], whatever way the pixels are stored."""

import struct
import zlib

import numpy as np
import pytest
import torch
from PIL import Image

from fecocodec.errors import InputError, OutputError
from fecocodec.formats.images import decode_image, read_image, read_image_size, write_image

HEIGHT, WIDTH = 40, 56


@pytest.fixture
def colours() -> np.ndarray:
    """Smooth, so that lossy formats keep it."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] / WIDTH
    return np.stack((u, v, 1 - u), axis=-1)


def to_bytes(colours: np.ndarray) -> np.ndarray:
    return (colours * 255).round().astype(np.uint8)


@pytest.mark.parametrize(("suffix", "tolerance"), [("png", 0.002), ("jpg", 0.03), ("webp", 0.04), ("exr", 1e-6)])
def test_written_image_reads_back(suffix, tolerance, colours, tmp_path):
    image = torch.from_numpy(colours).permute(2, 0, 1).float()
    path = tmp_path / f"image.{suffix}"
    write_image(path, image)
    assert read_image_size(path) == (HEIGHT, WIDTH)
    torch.testing.assert_close(read_image(path), image, atol=tolerance, rtol=0)


def test_eight_bits_are_kept_exactly(colours, tmp_path):
    Image.fromarray(to_bytes(colours)).save(tmp_path / "a.png")
    write_image(tmp_path / "b.png", read_image(tmp_path / "a.png"))
    assert np.array_equal(np.asarray(Image.open(tmp_path / "b.png")), to_bytes(colours))


def test_sixteen_bit_grey(colours, tmp_path):
    grey = (colours[..., 0] * 65535).round().astype(np.uint16)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    expected = torch.from_numpy(grey / 65535).float().expand(3, -1, -1)
    torch.testing.assert_close(read_image(tmp_path / "grey.png"), expected, atol=1e-6, rtol=0)


def png_of_sixteen_bits(samples: np.ndarray) -> bytes:
    """A PNG of 16 bits a channel, which Pillow does not write, of [height width 3 or 4] whole numbers."""
    height, width, channels = samples.shape
    head = struct.pack(">IIBBBBB", width, height, 16, {3: 2, 4: 6}[channels], 0, 0, 0)
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    framed = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)


def test_sixteen_bit_colour(colours, tmp_path):
    data = png_of_sixteen_bits((colours * 65535).round())
    (tmp_path / "image.png").write_bytes(data)
    expected = torch.from_numpy(colours).permute(2, 0, 1).float()
    torch.testing.assert_close(read_image(tmp_path / "image.png"), expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(decode_image(data, "frame 0"), expected, atol=1e-5, rtol=0)
    (tmp_path / "cut.png").write_bytes(data[:-200])
    with pytest.raises(InputError, match=r"cut\.png: the image is damaged, cut short"):
        read_image(tmp_path / "cut.png")


def test_sixteen_bit_colour_with_transparency_shows_white(tmp_path):
    samples = np.zeros((HEIGHT, WIDTH, 4))
    samples[..., 3] = 13000
    (tmp_path / "image.png").write_bytes(png_of_sixteen_bits(samples))
    expected = torch.full((3, HEIGHT, WIDTH), 1 - 13000 / 65535)
    torch.testing.assert_close(read_image(tmp_path / "image.png"), expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("mode", ["L", "P", "CMYK", "LA", "RGBA"])
def test_other_modes_are_converted(mode, colours, tmp_path):
    path = tmp_path / ("image.jpg" if mode == "CMYK" else "image.png")
    Image.fromarray(to_bytes(np.full_like(colours, 0.4))).convert(mode).save(path)
    torch.testing.assert_close(read_image(path), torch.full((3, HEIGHT, WIDTH), 0.4), atol=0.02, rtol=0)


def test_transparency_shows_white(tmp_path):
    pixels = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    pixels[..., 3] = 51  # 20% black over white
    Image.fromarray(pixels).save(tmp_path / "image.png")
    torch.testing.assert_close(read_image(tmp_path / "image.png"), torch.full((3, HEIGHT, WIDTH), 0.8))


def test_the_orientation_tag_is_ignored(colours, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # to be shown turned by 90 degrees
    Image.fromarray(to_bytes(colours)).save(tmp_path / "image.jpg", exif=exif, quality=95)
    assert read_image_size(tmp_path / "image.jpg") == (HEIGHT, WIDTH)
    assert read_image(tmp_path / "image.jpg").shape == (3, HEIGHT, WIDTH)


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "exr"])
def test_a_cut_image_is_refused_wherever_it_is_cut(suffix, colours, tmp_path):
    path = tmp_path / f"image.{suffix}"
    write_image(path, torch.from_numpy(np.random.default_rng(0).random((3, HEIGHT, WIDTH))).float())
    whole = path.read_bytes()
    for length in range(0, len(whole) - 12, len(whole) // 40):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="image"):
            read_image(path)


def test_a_missing_image_is_named(tmp_path):
    path = tmp_path / "no.png"
    with pytest.raises(InputError) as caught:
        read_image(path)
    assert str(caught.value) == f"{path}: no such image; put it there or leave its view out."


def test_too_many_pixels_are_refused_before_they_are_decoded(tmp_path, monkeypatch):
    Image.new("L", (200, 200)).save(tmp_path / "image.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    with pytest.raises(InputError, match=r"image\.png: the image has too many pixels .*; store it smaller\."):
        read_image(tmp_path / "image.png")


def test_an_unknown_suffix_is_not_written(tmp_path):
    with pytest.raises(OutputError, match=r"images of kind '\.gif' are not written; use one of \.png"):
        write_image(tmp_path / "image.gif", torch.zeros(3, 4, 4))
    assert not list(tmp_path.iterdir())


def test_nan_is_not_written(tmp_path):
    with pytest.raises(OutputError, match="the image holds NaN; nothing was written"):
        write_image(tmp_path / "image.png", torch.full((3, 4, 4), torch.nan))
    assert not list(tmp_path.iterdir())


def test_what_the_system_refuses_is_not_called_damage(tmp_path):
    (tmp_path / "image.png").mkdir()
    with pytest.raises(InputError) as caught:
        read_image(tmp_path / "image.png")
    assert str(caught.value) == (
        f"{tmp_path / 'image.png'}: cannot be read (Is a directory); check the path and its permissions."
    )
