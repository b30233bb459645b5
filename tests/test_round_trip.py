"""`encode` then `decode`: from posed photographs to Gaussians and nothing in between but bytes."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec.checkpoint import SENDER_FILE
from fecocodec.coding.visibility import MOST_VIEWS_FILLED
from fecocodec.container import Stream, list_sections, read_prefix, read_stream, write_stream
from fecocodec.errors import BitstreamError, InputError
from fecocodec.geometry.coding_grid import grid_size
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode
from fecocodec.sender.coverage import cells_to_bits
from fecocodec.sender.encode import encode
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig, steps_of_first
from fecocodec.splatting import emission
from fecocodec.splatting.background import DEFAULT_BACKGROUND
from fecocodec.splatting.occluded import occluded_layer
from tests.example_scenes import MODEL, example_views

ROOT = Path(__file__).resolve().parents[1]
FEW_STEPS = DEFAULT.with_steps(1)

CHILD = """
import json, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from fecocodec.receiver.decode import decode
gaussians = decode(Path(sys.argv[2]).read_bytes(), model=Path(sys.argv[3]), background=None, merging=None).gaussians
print(json.dumps([gaussians.count, sorted(name for name in sys.modules if name.startswith("fecocodec."))]))
"""


@pytest.fixture(scope="module")
def views() -> Views:
    return example_views(2)


@pytest.fixture(scope="module")
def data(views: Views, random_weights: Path) -> bytes:
    return encode(views, lmbda=1e-4, effort=FEW_STEPS, model=random_weights / MODEL)


def bare(data: bytes, weights: Path) -> Gaussians:
    """Return the Gaussians of the views alone, none of them merged."""
    return decode(data, model=weights / MODEL, background=None, merging=None).gaussians


def assert_equal(one: Gaussians, other: Gaussians) -> None:
    assert all(torch.equal(a, b) for a, b in zip(one.fields(), other.fields(), strict=True))


@pytest.mark.parametrize(
    ("num_views", "height", "width", "lmbda"),
    [
        (1, 64, 64, 1e-3),
        (2, 96, 160, 1e-5),
        (2, 70, 101, 1e-2),
        (4, 64, 64, 1e-5),
        (16, 64, 64, 1e-3),
        (1, 1024, 64, 1e-3),
        (1, 65, 1023, 1e-3),
    ],
)
def test_every_visible_cell_becomes_a_gaussian(
    random_weights: Path, num_views: int, height: int, width: int, lmbda: float
) -> None:
    views = example_views(num_views, height, width)
    data = encode(views, lmbda=lmbda, effort="fast", model=random_weights / MODEL)
    unfaded = write_stream(replace(read_stream(data), fading=None))
    decoded = decode(unfaded, model=random_weights / MODEL, background=None, merging=None)
    gaussians = decoded.gaussians
    grid_height, grid_width = grid_size(height, width)
    num_cells = num_views * grid_height * grid_width // 4
    # From three views on, random networks put some Gaussians before another camera's near bound, which fades them out.
    assert gaussians.count == num_cells if num_views < 3 else 0.85 * num_cells < gaussians.count <= num_cells
    assert all(bool(field.isfinite().all()) for field in gaussians.fields())
    header = read_stream(data).header
    assert (header.num_views, header.height, header.width) == (num_views, height, width)
    assert (decoded.stages, decoded.damage, decoded.image_size) == (2, None, (height, width))
    torch.testing.assert_close(decoded.cameras.extrinsics, views.cameras.extrinsics, atol=1e-6, rtol=0)


def test_latents_are_not_trivial_and_opaque_views_not_cut_out(data: bytes, views: Views, random_weights: Path) -> None:
    assert all(len(payload) > 100 for payload in read_stream(data).payloads)
    opaque = replace(views, alpha=torch.full((2, 64, 64), 0.5))
    assert encode(opaque, lmbda=1e-4, effort=FEW_STEPS, model=random_weights / MODEL) == data
    with pytest.raises(InputError, match="8192 pixels in all, more than the 8191 that are allowed"):
        decode(data, model=random_weights / MODEL, max_pixels=8191)
    assert decode(data, model=random_weights / MODEL, max_pixels=8192).stages == 2


@pytest.mark.parametrize("exponent", [-10, 7])
def test_the_unit_of_length_changes_the_cameras_and_no_payload(
    data: bytes, views: Views, random_weights: Path, exponent: int
) -> None:
    unit = 2.0**exponent
    extrinsics = views.cameras.extrinsics.clone()
    extrinsics[:, :3, 3] *= unit
    near, far = views.cameras.near * unit, views.cameras.far * unit
    scaled = replace(views, cameras=replace(views.cameras, extrinsics=extrinsics, near=near, far=far))
    other = encode(scaled, lmbda=1e-4, effort=FEW_STEPS, model=random_weights / MODEL)
    assert read_stream(other).payloads == read_stream(data).payloads
    small, large = (decode(of, model=random_weights / MODEL).gaussians for of in (data, other))
    torch.testing.assert_close(large.means, small.means * unit, atol=1e-5 * unit, rtol=1e-5)
    torch.testing.assert_close(large.scales, small.scales * unit)
    assert torch.equal(large.harmonics, small.harmonics)


def test_one_stage_of_two_is_what_a_file_cut_after_it_gives(data: bytes, random_weights: Path) -> None:
    end_of_b1 = next(section.offset for section in list_sections(data) if section.name == "B2")
    preview = decode(data, stages=1, model=random_weights / MODEL).gaussians
    assert_equal(decode(data[:end_of_b1], stages=1, model=random_weights / MODEL).gaussians, preview)
    whole = decode(data, model=random_weights / MODEL).gaussians
    assert not torch.equal(preview.harmonics, whole.harmonics)
    with pytest.raises(BitstreamError):
        decode(data[:end_of_b1], model=random_weights / MODEL)


def test_colours_may_be_had_that_are_the_same_from_everywhere(data: bytes, random_weights: Path) -> None:
    leaning, plain = (
        decode(data, sh_degree=degree, merging=None, model=random_weights / MODEL).gaussians for degree in (1, 0)
    )
    assert (leaning.harmonics.shape[1], plain.harmonics.shape[1]) == (4, 1)
    assert leaning.harmonics[:, 1:].abs().max() > 0
    assert_equal(replace(leaning, harmonics=plain.harmonics), plain)
    with pytest.raises(InputError, match="degree 3"):
        decode(data, sh_degree=3, model=random_weights / MODEL)


def test_a_stream_of_one_stage_equals_the_first_of_two_at_its_lambda(views: Views, random_weights: Path) -> None:
    """Where its latents are optimised in as many steps."""
    both = encode(views, lmbda=1e-4, effort=DEFAULT.with_steps(4), model=random_weights / MODEL)
    lmbda, effort = read_stream(both).header.lambda_of_stage(1), DEFAULT.with_steps(steps_of_first(4))
    assert lmbda == pytest.approx(6e-4, rel=0.01)
    single = encode(views, lmbda=lmbda, num_stages=1, effort=effort, model=random_weights / MODEL)
    assert read_stream(single).payloads == read_prefix(both, 1).payloads
    first = decode(both, stages=1, model=random_weights / MODEL).gaussians
    assert_equal(decode(single, model=random_weights / MODEL).gaussians, first)
    with pytest.raises(InputError, match="the stream has 1"):
        decode(single, stages=2, model=random_weights / MODEL)


@pytest.mark.parametrize("stage", [0, 1])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.99])
def test_a_damaged_payload_with_a_right_crc_is_an_error_too(
    data: bytes, random_weights: Path, stage: int, share: float
) -> None:
    stream = read_stream(data)
    payloads = [bytearray(payload) for payload in stream.payloads]
    payloads[stage][int(share * len(payloads[stage]))] ^= 0x10
    resealed = write_stream(Stream(stream.header, stream.cameras, tuple(bytes(payload) for payload in payloads)))
    with pytest.raises(BitstreamError):
        decode(resealed, model=random_weights / MODEL)


def test_decoded_gaussians_can_be_refined(data: bytes, random_weights: Path) -> None:
    colours = decode(data, model=random_weights / MODEL).gaussians.harmonics.requires_grad_()
    colours.square().sum().backward()
    assert colours.grad is not None and torch.equal(colours.grad, 2 * colours.detach())


def test_gaussians_of_cells_that_are_not_covered_are_dropped(data: bytes, random_weights: Path) -> None:
    stream, everything = read_stream(data), bare(data, random_weights)
    cells = torch.rand(2, 16, 16, generator=torch.Generator().manual_seed(0)) < 0.3
    covered = write_stream(replace(stream, coverage=cells_to_bits(cells)))
    assert read_prefix(covered, 1).coverage == cells_to_bits(cells)
    kept = cells.repeat_interleave(2, dim=1).repeat_interleave(2, dim=2).flatten()
    assert_equal(bare(covered, random_weights), everything.keep(kept))


@pytest.fixture(scope="module")
def transparent(views: Views) -> Views:
    """The views with a transparent left half, an edge at a third of the opacity, and one opaque pixel in the left."""
    alpha = torch.ones(2, 64, 64)
    alpha[:, :, :32], alpha[:, :, 32:36], alpha[1, 5, 6] = 0.0, 0.33, 0.5
    return replace(views, alpha=alpha)


def test_no_gaussians_are_emitted_for_transparent_cells(transparent: Views, random_weights: Path) -> None:
    coded = encode(transparent, lmbda=1e-4, effort=FEW_STEPS, model=random_weights / MODEL)
    without_coverage = write_stream(replace(read_stream(coded), coverage=None))
    is_emitted = torch.zeros(2, 32, 32, dtype=torch.bool)
    is_emitted[:, :, 18:], is_emitted[1, 2:4, 2:4] = True, True  # two Gaussians a cell of four pixels, each way
    everything = bare(without_coverage, random_weights)
    assert_equal(bare(coded, random_weights), everything.keep(is_emitted.flatten()))


def test_no_background_layer_continues_a_transparent_border(
    transparent: Views, data: bytes, random_weights: Path
) -> None:
    alpha = torch.zeros(2, 64, 64)
    alpha[:, 24:40, 24:40] = 1.0
    for shown, has_layer in ((alpha, False), (transparent.alpha, True)):
        coded = encode(replace(transparent, alpha=shown), lmbda=1e-4, effort="fast", model=random_weights / MODEL)
        plain, filled = (
            decode(coded, model=random_weights / MODEL, background=background).gaussians
            for background in (None, DEFAULT_BACKGROUND)
        )
        assert (filled.count > plain.count) == has_layer
        whole_layer = decode(data, model=random_weights / MODEL, merging=None).gaussians.count - 2 * 32 * 32
        assert filled.count - plain.count < whole_layer


@pytest.mark.parametrize(("effort", "is_optimised"), [("fast", False), (FEW_STEPS, True)])
def test_progress_moves_forward_and_names_what_is_done(
    views: Views, random_weights: Path, effort: str | OptimisationConfig, is_optimised: bool
) -> None:
    model, reports = random_weights / MODEL, list[tuple[str, float]]()
    data = encode(views, model=model, effort=effort, on_progress=lambda *report: reports.append(report))
    tasks, fractions = zip(*reports, strict=True)
    assert ("optimising stage 2" in tasks) == is_optimised
    assert tasks[:2] == ("matching views", "coding stage 1") and "coding stage 2" in tasks
    assert list(fractions) == sorted(fractions) and fractions[0] >= 0 and fractions[-1] <= 1
    shares: list[float] = []
    decode(data, model=model, on_progress=lambda _task, share: shares.append(share))
    assert shares == sorted(shares) and len(shares) == 3


def test_decoding_needs_nothing_of_the_sender(data: bytes, random_weights: Path, tmp_path: Path) -> None:
    model = tmp_path / "weights" / MODEL
    model.mkdir(parents=True)
    for file in (random_weights / MODEL).iterdir():
        if file.name != SENDER_FILE:
            (model / file.name).write_bytes(file.read_bytes())
    (tmp_path / "scene.fcs").write_bytes(data)
    arguments = [str(ROOT), str(tmp_path / "scene.fcs"), str(model)]
    child = subprocess.run([sys.executable, "-c", CHILD, *arguments], capture_output=True, text=True, check=True)
    count, modules = json.loads(child.stdout)
    assert count == 2 * 32 * 32
    assert "fecocodec.receiver.decode" in modules
    foreign = ("fecocodec.sender", "fecocodec.rendering", "fecocodec.training", "fecocodec.captures")
    assert [name for name in modules if name.startswith(foreign)] == []


def test_the_background_layer_comes_after_the_gaussians_of_the_views(random_weights: Path, data: bytes) -> None:
    plain, filled = (
        decode(data, model=random_weights / MODEL, background=background).gaussians
        for background in (None, DEFAULT_BACKGROUND)
    )
    assert filled.count > plain.count
    for mine, theirs in zip(plain.fields(), filled.fields(), strict=True):
        assert torch.equal(mine, theirs[: plain.count])


def test_nothing_is_added_behind_the_surfaces_of_a_cut_out_or_of_many_views(
    data: bytes, views: Views, random_weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alpha = torch.ones(2, 64, 64)
    alpha[:, :16] = 0.0
    cut_out = encode(replace(views, alpha=alpha), lmbda=1e-4, effort="fast", model=random_weights / MODEL)
    added: list[int] = []

    def counted(*scene: object) -> Gaussians:
        added.append(1)
        return occluded_layer(*scene)  # type: ignore[arg-type]

    monkeypatch.setattr(emission, "occluded_layer", counted)
    decode(cut_out, model=random_weights / MODEL)
    many = encode(example_views(MOST_VIEWS_FILLED + 1), lmbda=1e-2, effort="fast", model=random_weights / MODEL)
    decode(many, model=random_weights / MODEL)
    assert added == []
    decode(data, model=random_weights / MODEL)
    assert added == [1]
