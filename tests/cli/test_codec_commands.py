"""`encode`, `decode` and `render` on photographs, with the shipped weights."""

import json
import re
from pathlib import Path

import gsply
import numpy as np
import OpenEXR
import pytest
import torch
from fecosplat_cli.main import run

import fecocodec
from fecocodec.container import inspect
from fecocodec.photographs.exr import read_exr
from fecocodec.photographs.images import read_image


@pytest.fixture(scope="module")
def coded_scene(photographs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first two photographs, encoded with the shipped weights."""
    file = tmp_path_factory.mktemp("coded") / "wall.fcs"
    assert run(["encode", str(photographs), "-o", str(file), "--views", "0,1"]) == 0
    return file


def test_encode_writes_what_the_library_returns(coded_scene: Path, photographs: Path) -> None:
    views, guides = (fecocodec.read_views(photographs, views=views) for views in ((0, 1), (2, 3)))
    assert coded_scene.read_bytes() == fecocodec.encode(views, lmbda=1e-3, guides=guides)


def test_encode_reports_json(fecosplat, photographs: Path, tmp_path: Path) -> None:
    output = tmp_path / "wall.fcs"
    result = fecosplat("encode", photographs, "-o", output, "--views", "3", "--effort", "fast", "--json")
    fields = json.loads(result.out)
    assert (result.code, result.err) == (0, "")
    assert fields["output"] == str(output)
    assert fields["bytes"] == output.stat().st_size
    assert (fields["views"], fields["height"], fields["width"], fields["stages"]) == (3, 64, 96, 2)
    assert fields["lambda"] == pytest.approx(1e-3, rel=2e-3)
    views = fecocodec.read_views(photographs, views=tuple(view["name"] for view in fields["context_views"]))
    *_, quality = fecocodec.measure_decoded(output.read_bytes(), views)
    assert [view["psnr"] for view in fields["context_views"]] == pytest.approx(quality.psnr_of_view, abs=0.01)
    assert fields["context_psnr"] == pytest.approx(quality.psnr, abs=0.01)
    assert len(fields["guide_views"]) == 1
    assert (fields["check_views"], fields["new_view_psnr"]) == ([], None)
    sizes = [section["payload_bytes"] for section in fields["sections"] if section["name"] in ("B1", "B2")]
    assert [stage["kib"] for stage in fields["stage_results"]] == pytest.approx([n / 1024 for n in sizes], abs=0.02)


def test_encode_prints_size_and_quality_of_each_stage(fecosplat, photographs: Path, tmp_path: Path) -> None:
    result = fecosplat("encode", photographs, "-o", tmp_path / "a.fcs", "--views", "0,1", "--effort", "fast")
    quality = r" +\d+\.\d\d KiB +\d+\.\d\d dB"
    rest = r"\n  header, cameras and the like: [\d.]+ KiB"
    assert re.search(rf"{rest}\n  stage 1:{quality}\n  stage 2:{quality}\n  in all: {quality}, PSNR of the", result.err)
    assert "new views" not in result.err  # none was left out to measure
    assert "coded views: " not in result.err  # the user has named them
    assert "\nnote: of the others, 2 guide the encoder.\n" in f"\n{result.err}"


def test_encode_measures_photographs_that_it_did_not_use(fecosplat, photographs: Path, tmp_path: Path) -> None:
    arguments = ("--effort", "fast", "--checks", "1", "--views", "2", "--guides", "none", "--stages", "1")
    result = fecosplat("encode", photographs, "-o", tmp_path / "a.fcs", *arguments)
    on = r"measured on one photograph that was not used, view_\d\.png"
    of_new = rf"^  new views: {{13}} \d+\.\d\d dB, PSNR of new views, {on}$"
    assert re.search(of_new, result.err, re.MULTILINE)
    coded = r"note: coded views: view_\d\.png, view_\d\.png; of the others, 1 measures new views, 1 is not used"
    assert re.search(rf"{coded} \(--guides is none: view_\d\.png\)\.\n", result.err)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--checks", "3"), "3 checks asked for, but 2 photographs can be left for them; change --checks."),
        (("--guides", "roof.jpg"), "give indices or names, with commas between them, in --guides."),
    ],
)
def test_roles_that_are_not_possible(fecosplat, photographs: Path, tmp_path: Path, arguments, sentence: str) -> None:
    result = fecosplat("encode", photographs, "-o", tmp_path / "a.fcs", *arguments)
    assert (result.code, result.out) == (1, "") and sentence in result.err
    assert list(tmp_path.iterdir()) == []


def test_encode_chooses_views_by_name_size_and_bounds(fecosplat, photographs: Path, tmp_path: Path) -> None:
    output = tmp_path / "wall.fcs"
    arguments = ("--views", "view_2.png,view_0", "--size", "64x72", "--near", "1", "--far", "8")
    result = fecosplat("encode", photographs, "-o", output, *arguments, "--stages", "1", "--effort", "fast")
    summary = inspect(output.read_bytes())
    assert result.code == 0
    assert (summary.header.num_views, summary.header.width, summary.header.height) == (2, 64, 72)
    assert (summary.near, summary.far) == (1.0, 8.0)
    assert [section.name for section in summary.sections] == ["cameras", "B1"]


def test_decode_writes_what_the_library_returns(fecosplat, coded_scene: Path, tmp_path: Path) -> None:
    output = tmp_path / "wall.ply"
    for arguments, options in (((), {}), (("--stages", "1", "--overwrite"), {"stages": 1})):
        result = fecosplat("decode", coded_scene, "-o", output, "--json", *arguments)
        fields = json.loads(result.out)
        written, expected = fecocodec.read_ply(output), fecocodec.decode(coded_scene.read_bytes(), **options).gaussians
        assert (result.code, result.err) == (0, "")
        assert fields["gaussians"] == written.count == expected.count > 0
        torch.testing.assert_close(written.means, torch.from_numpy(expected.means), rtol=0, atol=1e-5)


def test_a_ply_has_degree_3_with_zeros_unless_another_is_asked_for(fecosplat, coded_scene: Path, output: Path) -> None:
    """Loaders that follow the 3DGS reference refuse any number of f_rest but 45."""
    found, means = {}, set()
    for name, options in (("default", ()), *((degree, ("--sh-degree", degree)) for degree in "02")):
        assert fecosplat("decode", coded_scene, "-o", output / f"{name}.ply", *options).code == 0
        found[name] = gsply.plyread(str(output / f"{name}.ply")).shN
        means.add(fecocodec.read_ply(output / f"{name}.ply").means.numpy().tobytes())
        assert (output / f"{name}.ply").read_bytes().count(b"float f_rest_") == 3 * found[name].shape[1]
    assert {name: rest.shape[1] for name, rest in found.items()} == {"default": 15, "0": 0, "2": 8}
    assert np.array_equal(found["default"][:, :8], found["2"]) and not found["default"][:, 3:].any()
    assert found["2"].any() and len(means) == 1
    assert fecosplat("decode", coded_scene, "-o", output / "default.ply", "--sh-degree", "4", "--overwrite").code == 2


def test_cameras_in_another_frame_than_the_gaussians_are_said(fecosplat, coded_scene: Path, output: Path) -> None:
    def notes(name: str, *options: str) -> list[str]:
        files = ("-o", output / name, "--save-cameras", output / "cameras.json", "--overwrite")
        printed = fecosplat("decode", coded_scene, *files, *options).err.splitlines()
        return [line for line in printed if line.startswith("note: the Gaussians")]

    assert notes("scene.glb") == [
        f"note: the Gaussians of {output / 'scene.glb'} have the frame upright, and the cameras of "
        f"{output / 'cameras.json'} the frame input; --frame upright or --frame input writes both in one."
    ]
    assert notes("scene.ply") == []
    assert notes("scene.glb", "--frame", "upright") == []


def test_render_writes_colour_and_depth_at_the_coded_cameras(fecosplat, coded_scene: Path, tmp_path: Path) -> None:
    result = fecosplat("render", coded_scene, "-o", tmp_path / "images", "--json")
    names = [f"wall_{view:02d}{suffix}" for view in range(2) for suffix in (".png", ".exr")]
    assert (result.code, result.err) == (0, "")
    assert json.loads(result.out)["outputs"] == [str(tmp_path / "images" / name) for name in names]
    image = read_exr(tmp_path / "images" / "wall_01.exr")
    assert image.colour.shape == (3, 64, 96)
    assert OpenEXR.File(str(tmp_path / "images" / "wall_01.exr")).channels()["Z"].pixels.shape == (64, 96)
    in_png = read_image(tmp_path / "images" / "wall_01.png")
    torch.testing.assert_close(in_png, image.colour, rtol=0, atol=0.003)


def test_outputs_that_render_refuses(fecosplat, stream_file: Path, tmp_path: Path) -> None:
    # The stream's payloads are no payloads: decoding it would fail with another sentence.
    images = tmp_path / "images"
    images.mkdir()
    (images / "scene_01.exr").write_text("precious")
    result = fecosplat("render", stream_file, "-o", images)
    assert result.code == 1
    assert result.err.startswith(f"fecosplat: {images / 'scene_01.exr'}: the file exists already")
    assert [file.name for file in images.iterdir()] == ["scene_01.exr"]
    result = fecosplat("render", stream_file, "-o", tmp_path / "view.png", "--path", "orbit", "--frames", 2)
    assert (result.code, result.err) == (
        1,
        f"fecosplat: {tmp_path / 'view.png'}: one file cannot hold 2 views; give a folder, or with --cameras the file "
        "name or the number of one view, such as --views 7, (7 without the comma is a count).\n",
    )
    output = tmp_path / "notes.txt"
    output.write_text("precious")
    result = fecosplat("render", stream_file, "-o", output)
    assert result.code == 1
    kinds = ".png or .jpg or .jpeg or .webp or .exr"
    assert result.err == f"fecosplat: {output}: files of kind .txt are not written here; use a folder or {kinds}.\n"
    assert output.read_text() == "precious"
