"""Colours of photographs become sRGB, however the file states what its numbers mean."""

import struct
import zlib

import numpy as np
import pytest
import torch
from PIL import Image

from fecocodec.photographs.colour import coded_to_srgb, is_srgb
from fecocodec.photographs.exr import linear_to_srgb
from fecocodec.photographs.images import decode_image, read_image, read_photograph
from fecocodec.photographs.pillow_images import gamma_with_pillow, upright_with_pillow

imagecodecs = pytest.importorskip("imagecodecs")  # writes profiles, and PNG of 16 bits

SRGB = (200, 40, 30)
DISPLAY_P3 = (184, 56, 42)  # the same colour, by the definitions of both
ADOBE_RGB = (172, 44, 36)
WHITE = [0.3127, 0.3290, 1.0]


def srgb_curve() -> np.ndarray:
    signal = np.linspace(0, 1, 4096)
    return np.where(signal <= 0.04045, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4).astype(np.float32)


def profile(*primaries: tuple[float, float]) -> bytes:
    points = [coordinate for x, y in primaries for coordinate in (x, y, 1.0)]
    return imagecodecs.cms_profile("rgb", whitepoint=WHITE, primaries=points, transferfunction=srgb_curve())


P3_PROFILE = profile((0.68, 0.32), (0.265, 0.69), (0.15, 0.06))
SRGB_PROFILE = profile((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))


def flat(colour: tuple[int, ...], mode: str = "RGB") -> Image.Image:
    return Image.new(mode, (64, 64), colour if len(colour) > 1 else colour[0])


def levels(image: torch.Tensor) -> list[int]:
    return (image[:, 5, 5] * 255).round().int().tolist()


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "tif", "avif"])
def test_display_p3_becomes_srgb(suffix, tmp_path):
    path = tmp_path / f"red.{suffix}"
    flat(DISPLAY_P3).save(path, icc_profile=P3_PROFILE, quality=100)
    assert levels(read_image(path)) == pytest.approx(SRGB, abs=0 if suffix in ("png", "tif") else 3)
    assert upright_with_pillow(path).getpixel((5, 5)) == pytest.approx(SRGB, abs=0 if suffix in ("png", "tif") else 3)
    assert levels(decode_image(path.read_bytes(), "frame 0")) == levels(read_image(path))


def test_display_p3_of_16_bits_becomes_srgb(tmp_path):
    samples = np.full((64, 64, 4), 13_000, np.uint16)
    samples[..., :3] = np.array(DISPLAY_P3) * 257
    encoded = imagecodecs.png_encode(samples)
    chunk = b"iCCP" + b"P3\0\0" + imagecodecs.zlib_encode(P3_PROFILE)
    after_head = 8 + 25
    data = encoded[:after_head] + struct.pack(">I", len(chunk) - 4) + chunk
    data += struct.pack(">I", imagecodecs.zlib_crc32(chunk)) + encoded[after_head:]
    (tmp_path / "red.png").write_bytes(data)
    photograph = read_photograph(tmp_path / "red.png", "black")
    colour, alpha = photograph.colour, photograph.alpha
    torch.testing.assert_close(alpha, torch.full((64, 64), 13_000 / 65535))
    assert (colour / alpha * 255)[:, 5, 5].tolist() == pytest.approx(SRGB, abs=0.4)


def test_profiles_of_other_images(tmp_path):
    clear = flat((*DISPLAY_P3, 51), "RGBA")
    clear.save(tmp_path / "clear.png", icc_profile=P3_PROFILE)
    photograph = read_photograph(tmp_path / "clear.png", "black")
    colour, alpha = photograph.colour, photograph.alpha
    torch.testing.assert_close(alpha, torch.full((64, 64), 0.2))
    assert levels(colour / alpha) == list(SRGB)
    flat(DISPLAY_P3).convert("P", palette=Image.Palette.ADAPTIVE).save(tmp_path / "p.png", icc_profile=P3_PROFILE)
    assert levels(read_image(tmp_path / "p.png")) == list(SRGB)
    linear = imagecodecs.cms_profile("gray", whitepoint=WHITE, gamma=1.0)
    flat((128,), "L").save(tmp_path / "grey.png", icc_profile=linear)
    assert levels(read_image(tmp_path / "grey.png")) == [188] * 3  # the sRGB signal of half the light
    flat(SRGB).save(tmp_path / "colour.png", icc_profile=linear)  # not of the image's kind
    assert levels(read_image(tmp_path / "colour.png")) == list(SRGB)
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png", icc_profile=SRGB_PROFILE)
    assert np.array_equal((read_image(tmp_path / "a.png") * 255).round().permute(1, 2, 0).numpy(), pixels)
    flat(SRGB).save(tmp_path / "a.png", icc_profile=P3_PROFILE[:100])
    assert levels(read_image(tmp_path / "a.png")) == list(SRGB)


def test_adobe_rgb_is_known_by_exif_data_too(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}  # interoperability index of DCF, for cameras without a profile
    flat(ADOBE_RGB).save(tmp_path / "a.jpg", exif=exif, quality=100, subsampling=0)
    assert levels(read_image(tmp_path / "a.jpg")) == pytest.approx(SRGB, abs=3)


def hlg(light: float) -> float:
    """Signal of scene light in [0, 1] (ITU-R BT.2100, table 5)."""
    return (3 * light) ** 0.5 if light <= 1 / 12 else 0.17883277 * np.log(12 * light - 0.28466892) + 0.55991073


def pq(nits: float) -> float:
    """Signal of light (SMPTE ST 2084, equation of the inverse EOTF)."""
    power = (nits / 10_000) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375


@pytest.mark.parametrize(("transfer", "signal"), [(16, pq(0.18 * 203)), (18, hlg((0.18 * 203 / 1000) ** (1 / 1.2)))])
def test_hdr_keeps_the_light_below_white_and_compresses_what_is_above(transfer, signal):
    """Grey of 18% of reference white, 203 nits; HLG on a display of 1000 nits."""
    pixels = np.full((2, 3, 3), signal, np.float32)
    pixels[1] = 1.0
    coded_to_srgb(pixels, 9, transfer)
    np.testing.assert_allclose(pixels[0], 0.4614, atol=1e-3)
    assert (pixels[1] > 0.97).all() and (pixels[1] < 1).all()


def test_wide_gamuts_of_sdr_become_srgb():
    pixels = np.array([[DISPLAY_P3]], np.float32) / 255
    coded_to_srgb(pixels, 12, 13)
    np.testing.assert_allclose(pixels[0, 0] * 255, SRGB, atol=0.5)
    assert is_srgb(1, 1) and is_srgb(2, 2) and not is_srgb(12, 1) and not is_srgb(9, 14) and not is_srgb(1, 18)


def test_heic_of_a_wide_gamut_without_a_profile(tmp_path):
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.register_heif_opener()
    flat(DISPLAY_P3).save(tmp_path / "a.heic", quality=100, chroma=444, color_primaries=12, transfer_characteristics=13)
    assert b"colrnclx\0\x0c\0\x0d" in (tmp_path / "a.heic").read_bytes()
    assert levels(read_image(tmp_path / "a.heic")) == pytest.approx(SRGB, abs=3)


def with_chunk(png: bytes, kind: bytes, data: bytes) -> bytes:
    """Add a chunk behind the head."""
    return png[:33] + struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) + png[33:]


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_of_linear_light_becomes_srgb(dtype, channels, tmp_path):
    plain, largest = tmp_path / "a.png", np.iinfo(dtype).max
    light = np.random.default_rng(0).integers(0, largest, (64, 64, channels), dtype, endpoint=True)
    if channels in (2, 4):
        light[..., -1] = largest
    plain.write_bytes(imagecodecs.png_encode(light.squeeze()))

    def read_with(kind: bytes, *numbers: int) -> torch.Tensor:
        data = b"".join(struct.pack(">I", number) for number in numbers)
        (tmp_path / "b.png").write_bytes(with_chunk(plain.read_bytes(), kind, data or b"\0"))
        return read_image(tmp_path / "b.png")

    values = torch.from_numpy(light[..., : 1 if channels < 3 else 3] / largest).float().movedim(-1, 0).expand(3, -1, -1)
    torch.testing.assert_close(read_with(b"gAMA", 100_000), linear_to_srgb(values), atol=0.6 / largest, rtol=0)
    assert gamma_with_pillow(tmp_path / "b.png") == 1.0
    for kind, numbers in ((b"gAMA", (45455,)), (b"gAMA", (0,)), (b"sRGB", ())):
        assert torch.equal(read_with(kind, *numbers), read_image(plain))
        assert gamma_with_pillow(tmp_path / "b.png") is None
    (tmp_path / "b.png").write_bytes(
        with_chunk(with_chunk(plain.read_bytes(), b"gAMA", struct.pack(">I", 100_000)), b"sRGB", b"\0")
    )
    assert torch.equal(read_image(tmp_path / "b.png"), read_image(plain))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_that_states_its_colours_by_numbers(dtype):
    levels_of = np.full((64, 64, 3), np.array(DISPLAY_P3) * (np.iinfo(dtype).max // 255), dtype)
    data = imagecodecs.png_encode(levels_of)
    stated = with_chunk(data, b"cICP", bytes([12, 13, 0, 1]))  # Display P3 with the curve of sRGB, RGB of full range
    assert np.abs(np.array(levels(decode_image(data, "a.png"))) - DISPLAY_P3).max() <= 1
    for png in (stated, with_chunk(stated, b"gAMA", struct.pack(">I", 100_000))):
        assert np.abs(np.array(levels(decode_image(png, "a.png"))) - SRGB).max() <= 1
