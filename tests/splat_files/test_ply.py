"""The PLY file is what 3DGS viewers expect; checked with gsply, a reader that is not ours."""

from dataclasses import replace

import gsply
import numpy as np
import pytest
import torch

from fecocodec.errors import InputError, OutputError
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.splat_files.gaussian_arrays import OPACITY_MARGIN
from fecocodec.splat_files.ply import read_ply, write_ply
from tests.splat_files import test_output_formats


def some_gaussians(count: int = 50, d_sh: int = 9) -> Gaussians:
    made = test_output_formats.some_gaussians(count, d_sh)
    return Gaussians(*(torch.as_tensor(field, dtype=torch.float32) for field in made.fields()))


@pytest.mark.parametrize("d_sh", [4, 9, 16])
def test_another_reader_sees_the_same_gaussians(d_sh, tmp_path):
    gaussians = some_gaussians(d_sh=d_sh)
    write_ply(tmp_path / "scene.ply", gaussians)
    seen = gsply.plyread(str(tmp_path / "scene.ply"))
    assert np.array_equal(seen.means, gaussians.means.numpy())
    assert np.array_equal(seen.quats, gaussians.rotations.numpy())
    assert np.array_equal(seen.sh0, gaussians.harmonics[:, 0].numpy())
    assert np.array_equal(seen.shN, gaussians.harmonics[:, 1:].numpy())
    np.testing.assert_allclose(seen.scales, np.log(gaussians.scales.numpy()), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(seen.opacities, torch.logit(gaussians.opacities).numpy(), rtol=1e-4, atol=1e-5)


def test_properties_in_the_usual_order(tmp_path):
    write_ply(tmp_path / "scene.ply", some_gaussians(d_sh=4))
    header = (tmp_path / "scene.ply").read_bytes().split(b"end_header\n")[0].decode().splitlines()
    assert header[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 50"]
    assert " ".join(line.removeprefix("property float ") for line in header[3:]) == (
        "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 f_rest_7 "
        "f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"
    )


@pytest.mark.parametrize("count", [0, 1, 50])
@pytest.mark.parametrize("d_sh", [1, 4, 9, 16])
def test_reads_back(count, d_sh, tmp_path):
    gaussians = some_gaussians(count, d_sh)
    write_ply(tmp_path / "scene.ply", gaussians)
    for read, written in zip(read_ply(tmp_path / "scene.ply").fields(), gaussians.fields(), strict=True):
        torch.testing.assert_close(read, written, rtol=1e-5, atol=1e-6)


def test_opacities_of_0_and_1_stay_finite(tmp_path):
    gaussians = replace(some_gaussians(2), opacities=torch.tensor([0.0, 1.0]))
    write_ply(tmp_path / "scene.ply", gaussians)
    assert np.isfinite(gsply.plyread(str(tmp_path / "scene.ply")).opacities).all()
    read = read_ply(tmp_path / "scene.ply").opacities
    torch.testing.assert_close(read, gaussians.opacities, rtol=0, atol=2 * OPACITY_MARGIN)


@pytest.mark.parametrize(
    ("field", "value", "cause"),
    [
        ("means", torch.nan, "values not finite in float32"),
        ("means", torch.inf, "values not finite in float32"),
        ("harmonics", torch.nan, "values not finite in float32"),
        ("rotations", -torch.inf, "values not finite in float32"),
        ("scales", torch.nan, "scales not above 0"),
        ("scales", 0.0, "scales not above 0"),
        ("scales", torch.inf, "values not finite in float32"),
        ("opacities", torch.nan, "opacities not in [0, 1]"),
        ("opacities", 1.01, "opacities not in [0, 1]"),
    ],
)
def test_nothing_is_written_that_no_viewer_could_use(field, value, cause, tmp_path):
    gaussians = some_gaussians()
    getattr(gaussians, field)[7] = value
    path = tmp_path / "scene.ply"
    with pytest.raises(OutputError) as caught:
        write_ply(path, gaussians)
    assert str(caught.value) == f"{path}: Gaussian 7 has {cause}; nothing was written, check their source."
    assert not list(tmp_path.iterdir())


def test_float64_beyond_float32_is_refused(tmp_path):
    gaussians = some_gaussians()
    with pytest.raises(OutputError, match="not finite in float32"):
        write_ply(tmp_path / "scene.ply", replace(gaussians, means=gaussians.means.double() * 1e300))


def refusal(path) -> str:
    with pytest.raises(InputError) as caught:
        read_ply(path)
    return str(caught.value).removeprefix(f"{path}: ")


NO_VERTEX = "the first element is not `vertex N`; give an uncompressed 3DGS .ply file."
NOT_FINITE = "a value is NaN or infinite; write the file again from finite Gaussians."


def renumbered(data: bytes) -> bytes:
    for number in reversed(range(9)):
        data = data.replace(b"float f_rest_%d\n" % number, b"float f_rest_%d\n" % (number + 24))
    return data


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda whole: b"plymouth", "this is not a PLY file; give a 3DGS .ply file."),
        (lambda whole: whole[:-1], "50 vertices need 8200 bytes but 8199 are there; get the whole file."),
        (
            lambda whole: whole.replace(b"binary_little_endian", b"ascii"),
            "only binary little-endian PLY is read; convert the file.",
        ),
        (
            lambda whole: whole.replace(b"property float opacity", b"property float alpha"),
            "not Gaussians (missing ['opacity'], 24 f_rest); give a 3DGS .ply file.",
        ),
        (
            renumbered,
            f"not Gaussians (missing {[f'f_rest_{number}' for number in range(9)]}, 24 f_rest); give a 3DGS .ply file.",
        ),
        (
            lambda whole: whole.replace(b"float opacity", b"uchar opacity"),
            "a vertex property is not a float; give an uncompressed 3DGS .ply file.",
        ),
        (lambda whole: whole.replace(b"element vertex 50", b"element chunk 50"), NO_VERTEX),
        (lambda whole: whole.replace(b"vertex 50", b"vertex " + b"9" * 5000), NO_VERTEX),
        (lambda whole: whole[:-4] + np.float32(np.nan).tobytes(), NOT_FINITE),
        (lambda whole: whole[:-32] + np.full(8, 3e38, "<f4").tobytes(), NOT_FINITE),  # opacity, scales, rotation
    ],
)
def test_files_that_cannot_be_read(spoil, sentence, tmp_path):
    path = tmp_path / "scene.ply"
    write_ply(path, some_gaussians())
    path.write_bytes(spoil(path.read_bytes()))
    assert refusal(path) == sentence


def test_what_is_no_file_cannot_be_read(tmp_path):
    path = tmp_path / "scene.ply"
    assert refusal(path) == "cannot be read (No such file or directory); check the path."
    path.symlink_to("/dev/zero")
    assert refusal(path) == "a pipe or a device cannot be read here; give a regular file."


def test_any_cut_is_refused(tmp_path):
    path = tmp_path / "scene.ply"
    write_ply(path, some_gaussians(count=1, d_sh=1))
    whole = path.read_bytes()
    for length in range(0, len(whole), 5):
        path.write_bytes(whole[:length])
        assert refusal(path).endswith(".")


def test_paths_may_be_text_and_headers_spaced_freely(tmp_path):
    path = tmp_path / "scene.ply"
    write_ply(str(path), some_gaussians())
    path.write_bytes(path.read_bytes().replace(b"element vertex 50", b"element  vertex 50 "))
    assert read_ply(str(path)).count == 50
