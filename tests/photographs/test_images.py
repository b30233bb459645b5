"""Photographs are read as sRGB in [0, 1], whatever way the pixels are stored."""

import os
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image, ImageOps

from fecocodec.errors import InputError, OutputError
from fecocodec.photographs.image_headers import has_image_name, is_upright, read_image_size
from fecocodec.photographs.images import decode_image, read_image, read_photograph, write_image
from fecocodec.photographs.pillow_images import unreadable, upright_with_pillow

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


def test_sixteen_bits(colours, tmp_path):
    grey = (colours[..., 0] * 65535).round().astype(np.uint16)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    expected = torch.from_numpy(grey / 65535).float().expand(3, -1, -1)
    torch.testing.assert_close(read_image(tmp_path / "grey.png"), expected, atol=1e-6, rtol=0)
    data = png_of_sixteen_bits((colours * 65535).round())
    (tmp_path / "image.png").write_bytes(data)
    expected = torch.from_numpy(colours).permute(2, 0, 1).float()
    torch.testing.assert_close(read_image(tmp_path / "image.png"), expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(decode_image(data, "frame 0"), expected, atol=1e-5, rtol=0)
    (tmp_path / "cut.png").write_bytes(data[:-200])
    with pytest.raises(InputError, match=r"cut\.png: the image is damaged, cut short"):
        read_image(tmp_path / "cut.png")


def png_of_sixteen_bits(samples: np.ndarray) -> bytes:
    """A PNG of 16 bits a channel, which Pillow does not write, of [height width 1 to 4] whole numbers."""
    height, width, channels = samples.shape
    head = struct.pack(">IIBBBBB", width, height, 16, {1: 0, 2: 4, 3: 2, 4: 6}[channels], 0, 0, 0)
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    return png_of_chunks((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))


@pytest.mark.parametrize(
    ("colour", "alpha", "largest"),
    [((40_001,), 13_000, 65535), ((0, 0, 0), 13_000, 65535), ((0, 0, 0), 51, 255)],
    ids=["grey of 16 bits", "colour of 16 bits", "colour of 8 bits"],
)
def test_transparency_shows_white_and_is_returned(colour, alpha, largest, tmp_path):
    samples, path = np.full((HEIGHT, WIDTH, len(colour) + 1), (*colour, alpha)), tmp_path / "image.png"
    if largest == 255:
        Image.fromarray(samples.astype(np.uint8)).save(path)
    else:
        path.write_bytes(png_of_sixteen_bits(samples))
    share, signal = alpha / largest, colour[0] / largest
    photograph = read_photograph(str(path))
    on_white, opacity = photograph.colour, photograph.alpha
    torch.testing.assert_close(opacity, torch.full((HEIGHT, WIDTH), share), atol=1e-6, rtol=0)
    expected = torch.full((3, HEIGHT, WIDTH), 1 - share + share * signal)
    torch.testing.assert_close(on_white, expected, atol=1e-5, rtol=0)
    assert torch.equal(read_image(path), on_white)
    on_black = read_photograph(path, "black").colour
    torch.testing.assert_close(on_black / opacity, torch.full((3, HEIGHT, WIDTH), signal), atol=1e-6, rtol=0)


def test_sixteen_bits_without_the_package_are_one_sentence(tmp_path, monkeypatch):
    (tmp_path / "image.png").write_bytes(png_of_sixteen_bits(np.zeros((HEIGHT, WIDTH, 3))))
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(
        InputError, match=r"image\.png: a PNG with 16 bits .*`pip install '\.\[png16\]'` in .*, or store"
    ):
        read_image(tmp_path / "image.png")
    assert read_image_size(tmp_path / "image.png") == (HEIGHT, WIDTH)


@pytest.mark.parametrize("mode", ["L", "P", "CMYK", "LA", "RGBA"])
def test_other_modes_are_converted(mode, colours, tmp_path):
    path = tmp_path / ("image.jpg" if mode == "CMYK" else "image.png")
    Image.fromarray(to_bytes(np.full_like(colours, 0.4))).convert(mode).save(path)
    torch.testing.assert_close(read_image(path), torch.full((3, HEIGHT, WIDTH), 0.4), atol=0.02, rtol=0)


def test_other_suffixes_of_kinds_that_are_read(colours, tmp_path):
    first = Image.fromarray(to_bytes(colours))
    first.save(tmp_path / "a.mpo", save_all=True, append_images=[first.rotate(90)], quality=95)
    first.save(tmp_path / "a.apng", format="PNG")
    for path in tmp_path.iterdir():
        assert has_image_name(path)
        expected = torch.from_numpy(colours).permute(2, 0, 1).float()
        torch.testing.assert_close(read_image(path), expected, atol=0.03, rtol=0)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
def test_the_orientation_tag_is_ignored(suffix, orientation, colours, tmp_path):
    exif, path = Image.Exif(), tmp_path / f"image.{suffix}"
    exif[0x0112] = orientation
    Image.fromarray(to_bytes(colours)).save(path, exif=exif, quality=95)
    assert read_image_size(path) == (HEIGHT, WIDTH)
    expected = torch.from_numpy(colours).permute(2, 0, 1).float()
    torch.testing.assert_close(read_image(path), expected, atol=0.04, rtol=0)
    assert is_upright(path) == (orientation == 1)
    with Image.open(path) as image:
        shown = np.asarray(ImageOps.exif_transpose(image)).astype(int)
    assert np.abs(np.asarray(upright_with_pillow(path)) - shown).max() <= 2


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "exr"])
def test_a_cut_image_is_refused_wherever_it_is_cut(suffix, colours, tmp_path):
    path = tmp_path / f"image.{suffix}"
    write_image(path, torch.from_numpy(np.random.default_rng(0).random((3, HEIGHT, WIDTH))).float())
    whole = path.read_bytes()
    for length in range(0, len(whole) - 12, len(whole) // 40):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="image"):
            read_image(path)


def test_decoders_that_print_or_break_lines_give_one_sentence(tmp_path, capfd):
    path = tmp_path / "image.tif"
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(path, compression="tiff_deflate")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3] + bytes(9) + data[len(data) // 3 + 9 :])
    with pytest.raises(InputError, match=r"image\.tif: the image is damaged.* \(decoder error -2\); store it again"):
        read_image(path)
    assert capfd.readouterr() == ("", "")
    assert "(two lines); store it" in unreadable(path, ValueError("two\n lines\n"))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: None, "no such image; put it there or leave its view out."),
        (Path.mkdir, "cannot be read (Is a directory); check the path and its permissions."),
        (
            lambda path: path.write_text("this is no image"),
            "the image is damaged, cut short or of a kind that is not read; store it again or remove it.",
        ),
    ],
)
def test_what_the_system_refuses_is_not_called_damage(make, sentence, tmp_path):
    path = tmp_path / "image.png"
    make(path)
    with pytest.raises(InputError) as caught:
        read_image(path)
    assert str(caught.value) == f"{path}: {sentence}"


@pytest.mark.parametrize(("width", "height"), [(9400, 9400), (8193, 8192), (100_000, 100_000)])
def test_too_many_pixels_are_refused_before_they_are_decoded(tmp_path, width, height):
    """The file has no pixels, so a reader that decodes first reports that it is cut short."""
    whole = png_of_sixteen_bits(np.zeros((1, 1, 3)))
    head = b"IHDR" + struct.pack(">II", width, height) + whole[24:29]
    (tmp_path / "image.png").write_bytes(whole[:12] + head + struct.pack(">I", zlib.crc32(head)) + whole[33:])
    for read in (read_image, read_image_size):
        with pytest.raises(InputError, match=r"image\.png: the image has too many pixels.*; store it smaller\."):
            read(tmp_path / "image.png")


def png_of_chunks(*chunks: tuple[bytes, bytes]) -> bytes:
    framed = (struct.pack(">I", len(d)) + kind + d + struct.pack(">I", zlib.crc32(kind + d)) for kind, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)


@pytest.mark.parametrize(
    ("colour_type", "extra"), [(3, ()), (2, ((b"iCCP", b"ab"),)), (0, ((b"iCCP", b"a\0"),)), (2, ((b"tRNS", b"a"),))]
)
def test_damaged_png_chunks_are_one_sentence(tmp_path, colour_type, extra):
    """A palette image without palette, and profiles and transparency of two bytes."""
    head = struct.pack(">IIBBBBB", 8, 8, 8, colour_type, 0, 0, 0)
    rows = 8 * (b"\0" + bytes(8 * (3 if colour_type == 2 else 1)))
    data = png_of_chunks((b"IHDR", head), *extra, (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    (tmp_path / "image.png").write_bytes(data)
    with pytest.raises(
        InputError,
        match=r"image\.png: the image is damaged, cut short or of a kind that is not read.*; store it again or",
    ):
        read_image(tmp_path / "image.png")


def test_pipes_devices_and_huge_files_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "zero.exr").symlink_to("/dev/zero")
    for name in ("pipe.png", "zero.exr"):
        for read in (read_image, read_image_size):
            with pytest.raises(InputError, match="a pipe or a device cannot be read here; give a regular file"):
                read(tmp_path / name)
    for name in ("huge.png", "huge.exr"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(513 << 20)  # sparse: it takes no space
        with pytest.raises(InputError, match="537919488 bytes, but at most 536870912 are read; give a smaller file"):
            read_image(tmp_path / name)


def test_opaque_alpha_is_no_alpha(tmp_path):
    """Else the same file would be measured against another background."""
    pixels = np.full((HEIGHT, WIDTH, 4), 255, np.uint8)
    for opaque in (pixels, pixels[..., :3]):
        Image.fromarray(opaque).save(tmp_path / "image.png")
        assert read_photograph(tmp_path / "image.png").alpha is None
    pixels[3, 2, 3] = 254
    Image.fromarray(pixels).save(tmp_path / "image.png")
    assert read_photograph(tmp_path / "image.png").alpha is not None


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("image.gif", 0.0, r"images of kind '\.gif' are not written; use one of \.png"),
        ("image.png", torch.nan, "the image holds NaN; nothing was written"),
    ],
)
def test_what_cannot_be_written_leaves_nothing(name, value, sentence, tmp_path):
    with pytest.raises(OutputError, match=sentence):
        write_image(tmp_path / name, torch.full((3, 4, 4), value))
    assert not list(tmp_path.iterdir())
