"""OpenEXR holds linear light and depth; checked through OpenEXR's own reader and writer."""

import struct

import numpy as np
import OpenEXR
import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.photographs.exr import (
    colour_layer,
    linear_to_srgb,
    read_exr,
    read_exr_size,
    srgb_to_linear,
    write_exr,
)

HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def store(path, channels, **header) -> None:
    OpenEXR.File(HEADER | header, channels).write(str(path))


def test_colour_is_stored_as_linear_light_and_depth_as_it_is(tmp_path):
    srgb = torch.tensor([0.0, 0.04, 0.5, 1.0]).expand(3, 2, 4).contiguous()
    depth = torch.rand(2, 4) * 10
    write_exr(tmp_path / "image.exr", srgb, depth)
    channels = OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True).channels()
    assert set(channels) == {"R", "G", "B", "Z"}
    expected = [0.0, 0.04 / 12.92, ((0.5 + 0.055) / 1.055) ** 2.4, 1.0]
    np.testing.assert_allclose(channels["G"].pixels[1], expected, rtol=1e-5)
    assert np.array_equal(channels["Z"].pixels, depth.numpy())
    torch.testing.assert_close(read_exr(tmp_path / "image.exr").colour, srgb, atol=1e-6, rtol=0)


def test_the_two_transfer_functions_are_inverse():
    values = torch.linspace(0, 1, 1001)
    torch.testing.assert_close(linear_to_srgb(srgb_to_linear(values)), values, atol=2e-6, rtol=0)
    assert linear_to_srgb(torch.tensor(0.18)).item() == pytest.approx(0.4614, abs=1e-4)  # middle grey


PLANE = np.full((2, 3), 0.18, np.float32)
HALVES = {"R": PLANE.astype(np.float16), "G": 0 * PLANE, "B": np.ones((2, 3), np.float16), "A": np.ones_like(PLANE)}


@pytest.mark.parametrize(
    ("channels", "colour", "alpha"),
    [
        ({"RGB": np.array([[[0.18, 5.0, np.nan]] * 3] * 2, np.float16)}, [0.4614, 1.0, 0.0], None),
        ({"RGBA": np.full((2, 3, 4), 0.25, np.float32)}, [1.0, 1.0, 1.0], 0.25),  # premultiplied, on white
        ({"Y": PLANE}, [0.4614] * 3, None),
        ({"R": PLANE, "Y": PLANE}, [0.4614] * 3, None),
        (HALVES, [0.4614, 0.0, 1.0], None),
    ],
    ids=["half floats, bright light and NaN", "opacity", "luminance", "luminance and red", "halves and floats"],
)
def test_kinds_of_channels(channels, colour, alpha, tmp_path):
    store(tmp_path / "image.exr", channels)
    image = read_exr(tmp_path / "image.exr")
    assert read_exr_size(tmp_path / "image.exr") == (2, 3)
    expected = torch.tensor(colour)[:, None, None].expand(3, 2, 3)
    torch.testing.assert_close(image.colour, expected, atol=1e-4, rtol=0)
    assert alpha is None or torch.equal(image.alpha, torch.full((2, 3), alpha))


NORMALS = {f"Normal.{axis}": PLANE for axis in "XYZ"}


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        ({"Z": PLANE}, "no colour among the channels ['Z']; store R, G and B."),
        (
            {f"{layer}.{name}": PLANE for layer in ("left", "right") for name in "RGB"},
            "several layers have colour (left, right); store the wanted one as R, G and B.",
        ),
        (
            NORMALS,
            "no colour among the channels ['Normal.X', 'Normal.Y', 'Normal.Z']; store R, G and B.",
        ),
    ],
)
def test_files_without_one_colour_are_refused(channels, sentence, tmp_path):
    path = tmp_path / "image.exr"
    store(path, channels)
    with pytest.raises(InputError) as caught:
        read_exr(path)
    assert str(caught.value) == f"{path}: {sentence}"


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


def test_a_file_that_is_cut_short_is_refused_in_one_sentence(tmp_path, capfd):
    image = torch.rand(3, 128, 128)
    write_exr(tmp_path / "a.exr", image)
    (tmp_path / "a.exr").write_bytes((tmp_path / "a.exr").read_bytes()[:80_000])
    with pytest.raises(InputError, match=r"a\.exr: the image is damaged, cut short or not OpenEXR"):
        read_exr(tmp_path / "a.exr")
    assert capfd.readouterr() == ("", "")  # OpenEXR prints of its own


def window(left: int, top: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([left + width - 1, top + height - 1], np.int32)


@pytest.mark.parametrize(("left", "top"), [(2, 1), (-1, -2), (6, 0)])
def test_pixels_lie_where_the_data_window_is_in_the_display_window(left, top, tmp_path):
    """Smaller than the display window, larger (overscan), and with another origin."""
    values = np.random.default_rng(0).random((6, 7, 3), np.float32)
    path = tmp_path / "image.exr"
    windows = {"dataWindow": window(left + 4, top + 4, 7, 6), "displayWindow": window(4, 4, 8, 5)}
    store(path, {"RGBA": np.concatenate((values, np.ones((6, 7, 1), np.float32)), axis=2)}, **windows)
    assert read_exr_size(path) == (5, 8)
    image = read_exr(path, background=0.0)
    expected = np.zeros((5, 8, 4), np.float32)
    for v in range(5):
        for u in range(8):
            if 0 <= v - top < 6 and 0 <= u - left < 7:
                expected[v, u] = (*values[v - top, u - left], 1)
    torch.testing.assert_close(srgb_to_linear(image.colour), torch.from_numpy(expected[..., :3]).permute(2, 0, 1))
    assert torch.equal(image.alpha, torch.from_numpy(expected[..., 3]))


def test_the_colours_of_a_layer_or_another_part_are_read(tmp_path):
    grey = dict.fromkeys("RGB", PLANE)
    blender = {f"ViewLayer.Combined.{name}": plane for name, plane in grey.items()}
    others = {f"ViewLayer.DiffCol.{name}": plane / 2 for name, plane in grey.items()}
    nuke = {f"beauty.{name}": plane for name, plane in zip(("red", "green", "blue"), grey.values(), strict=True)}
    combined = "ViewLayer.Combined"
    for channels, layer in ((blender, combined), (others | blender, combined), (nuke, "beauty")):
        store(tmp_path / "layer.exr", channels | {"ViewLayer.Depth.Z": np.ones((2, 3), np.float32)})
        assert colour_layer(tmp_path / "layer.exr") == layer
        colour = read_exr(tmp_path / "layer.exr").colour
        torch.testing.assert_close(colour, torch.full((3, 2, 3), 0.4614), atol=1e-4, rtol=0)
    depth = OpenEXR.Part(dict(HEADER), {"Z": np.ones((2, 3), np.float32)}, "depth")
    OpenEXR.File([depth, OpenEXR.Part(dict(HEADER), grey, "picture")]).write(str(tmp_path / "parts.exr"))
    assert colour_layer(tmp_path / "parts.exr") == "picture"
    assert read_exr(tmp_path / "parts.exr").colour[0, 0, 0].item() == pytest.approx(0.4614, abs=1e-4)
    store(tmp_path / "normals.exr", NORMALS | {f"Layer.{kind}": PLANE for kind in "RGB"})
    assert colour_layer(tmp_path / "normals.exr") == "Layer"
    store(tmp_path / "plain.exr", grey)
    assert colour_layer(tmp_path / "plain.exr") == ""


def test_light_that_is_not_in_0_to_1_is_counted(tmp_path):
    light = np.full((2, 4, 3), 1.0, np.float16)
    light[0, 0, 1] = 1.001  # the next half float
    store(tmp_path / "image.exr", {"RGB": light})
    assert read_exr(tmp_path / "image.exr").clipped == 1 / 8
    light = np.full((2, 4, 3), 0.25, np.float32)
    light[0, 0, 1], light[1, 3, 2], light[1, 2, 0] = np.nan, -0.5, -1e-6
    store(tmp_path / "image.exr", {"RGB": light})
    image = read_exr(tmp_path / "image.exr")
    assert image.blackened == 2 / 8 and image.colour[1, 0, 0] == image.colour[2, 1, 3] == 0


def test_other_primaries_become_srgb(tmp_path):
    # ACEScg, whose white is adapted; the red primary of sRGB in ACEScg, from the ACES documents.
    acescg = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    light = np.array([[[1, 1, 1], [0.61309732, 0.07019372, 0.02061559]]], np.float32)
    store(tmp_path / "image.exr", {"RGB": light}, chromaticities=acescg)
    colour = srgb_to_linear(read_exr(tmp_path / "image.exr").colour)
    torch.testing.assert_close(colour, torch.tensor([[[1.0, 1.0]], [[1.0, 0.0]], [[1.0, 0.0]]]), atol=2e-3, rtol=0)
    light = np.random.default_rng(0).random((2, 3, 3), np.float32)
    of_rgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]  # IEC 61966-2-1
    xyz = np.moveaxis(light @ np.array(of_rgb, np.float32).T, -1, 0)
    store(tmp_path / "a.exr", dict(zip("XYZ", map(np.ascontiguousarray, xyz), strict=True)))
    image = read_exr(tmp_path / "a.exr")
    torch.testing.assert_close(srgb_to_linear(image.colour), torch.from_numpy(light).movedim(-1, 0), atol=5e-4, rtol=0)


def exr_of_luminance_and_chroma(luma: np.ndarray, red: np.ndarray, blue: np.ndarray) -> bytes:
    """An uncompressed file of float channels Y, and RY and BY at every second pixel, which the binding cannot write."""

    def attribute(name: str, kind: str, data: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    height, width = luma.shape
    channels = (
        name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, step, step)
        for name, step in (("BY", 2), ("RY", 2), ("Y", 1))
    )
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = struct.pack("<II", 20000630, 2) + attribute("channels", "chlist", b"".join(channels) + b"\0")
    head += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    head += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    head += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", bytes(8)) + attribute("screenWindowWidth", "float", bytes(4)) + b"\0"
    rows = []
    for row in range(height):
        planes = [luma[row]] if row % 2 else [blue[row // 2], red[row // 2], luma[row]]
        data = np.concatenate(planes).astype("<f4").tobytes()
        rows.append(struct.pack("<ii", row, len(data)) + data)
    starts = np.cumsum([len(head) + 8 * height, *map(len, rows[:-1])])
    return head + starts.astype("<u8").tobytes() + b"".join(rows)


def test_luminance_and_chroma_are_colours(tmp_path):
    luma = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722 * 0.1
    red, blue = 0.5 / luma - 1, 0.1 / luma - 1
    data = exr_of_luminance_and_chroma(np.full((4, 6), luma), np.full((2, 3), red), np.full((2, 3), blue))
    (tmp_path / "image.exr").write_bytes(data)
    light = srgb_to_linear(read_exr(tmp_path / "image.exr").colour)
    torch.testing.assert_close(light, torch.tensor([0.5, 0.25, 0.1])[:, None, None].expand(3, 4, 6), atol=1e-4, rtol=0)
