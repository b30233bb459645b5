"""Cut-out photographs: what is emitted of them, and that optimisation judges them on more than one background.

Which cells count as covered, from the opacity of the views as given.
"""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from fecocodec import read_views
from fecocodec.coding.visibility import visibility_of
from fecocodec.container import quantise_lambda, read_stream
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.metrics import psnr
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.sender.codec import Codec
from fecocodec.sender.coverage import covered_cells
from fecocodec.sender.encode import write_scene
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.references import References
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder

ROOT = Path(__file__).parents[2]
SIZE = (64, 96)
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def cut_out_views() -> Views:
    """The bundled pair, cut out by an ellipse with a soft rim."""
    views = read_views(ROOT / "examples" / "motorcycle", size=SIZE)
    rows, columns = torch.meshgrid(torch.linspace(-1, 1, SIZE[0]), torch.linspace(-1, 1, SIZE[1]), indexing="ij")
    opacity = (8.0 * (0.8 - torch.hypot(rows, columns))).clamp(0, 1).expand(len(views.images), *SIZE)
    return replace(views, images=views.images * opacity[:, None] + 1.0 - opacity[:, None], alpha=opacity)


def test_pictures_and_photographs_are_on_white_then_on_black(monkeypatch: pytest.MonkeyPatch) -> None:
    on_white = torch.tensor([0.5, 0.5, 1.0]).expand(1, 3, 1, 3)
    on_black = torch.tensor([0.5, 0.25, 0.0]).expand(1, 3, 1, 3)
    cameras = Cameras(torch.eye(4)[None], torch.eye(3)[None], torch.ones(()), torch.ones(()))
    references = References(cameras, on_white, torch.tensor([0.0, 0.25, 1.0]).reshape(1, 1, 1, 3), 1)
    assert torch.equal(references.pictures, torch.cat((on_white, on_black)))
    rendering = Rendering(on_black, torch.zeros(1, 1, 3), torch.tensor([1.0, 0.75, 0.0]).reshape(1, 1, 3))
    monkeypatch.setattr("fecocodec.sender.references.render", lambda *_: rendering)
    nothing = Gaussians(*(torch.zeros(0, *shape) for shape in ((3,), (3,), (4,), (), (1, 3))))
    assert torch.equal(references.rendered(nothing), torch.cat((on_white, on_black)))


@torch.no_grad()
def test_photographs_are_compared_as_they_are_emitted(shipped_codec: Codec, cut_out_views: Views) -> None:
    views = read_views(ROOT / "examples" / "motorcycle", size=SIZE)
    encoder = SceneEncoder.of(shipped_codec, prepare_scene(views, shipped_codec.device))
    assert encoder.cut_out is None
    assert torch.equal(References.of(encoder).pictures, encoder.images[0])
    scene = prepare_scene(cut_out_views, shipped_codec.device)
    encoder = SceneEncoder.of(shipped_codec, scene)
    assert encoder.cut_out is not None
    visibility = visibility_of(read_stream(write_scene(encoder, scene, quantise_lambda(1e-2), 1, DEFAULT)))
    assert visibility is not None
    assert torch.equal(encoder.cut_out.is_covered.flatten().float(), torch.from_numpy(visibility))


@torch.no_grad()
def test_cut_outs_come_out_better_than_when_judged_on_white_alone(shipped_codec: Codec, cut_out_views: Views) -> None:
    scene = prepare_scene(cut_out_views, shipped_codec.device)
    assert cut_out_views.alpha is not None
    opacity = cut_out_views.alpha[:, None]
    quality = {}
    for name, encoder in (
        ("both", SceneEncoder.of(shipped_codec, scene)),
        ("white", SceneEncoder(shipped_codec, scene.images, scene.cameras)),
    ):
        gaussians = decode_with(
            shipped_codec.receiver, write_scene(encoder, scene, quantise_lambda(1e-4), 2, DEFAULT)
        ).gaussians
        for background, image in ((WHITE, cut_out_views.images), (BLACK, cut_out_views.images - (1.0 - opacity))):
            picture = render(gaussians, cut_out_views.cameras, SIZE, background).color.clamp(0, 1)
            quality[name, background] = float(psnr(picture, image).mean())
    assert quality["both", BLACK] > quality["white", BLACK] + 0.5
    assert quality["both", WHITE] > quality["white", WHITE]


def test_covered_cells() -> None:
    alpha = torch.zeros(2, 64, 64)
    alpha[1, 11, 20] = 0.5
    cells = covered_cells(alpha, (2, 16, 16))
    assert cells.nonzero().tolist() == [[1, 2, 5]]
    assert not covered_cells(0.99 * alpha, (2, 16, 16)).any()
    # 70 rows on a grid of 64: cell 0 spans rows 0 to 4.375, cell 15 spans rows 65.625 to 70.
    alpha = torch.zeros(1, 70, 64)
    alpha[0, 4, 0], alpha[0, 69, 63] = 1.0, 1.0
    assert covered_cells(alpha, (1, 16, 16)).nonzero().tolist() == [[0, 0, 0], [0, 1, 0], [0, 15, 15]]
    alpha = torch.zeros(1, 64, 64)
    alpha[:, :, :10] = 1.0  # half of the third column of cells
    assert covered_cells(alpha, (1, 16, 16))[0, 0].nonzero().flatten().tolist() == [0, 1]
    alpha[:, :, 10], alpha[:, :, 11] = 1.0, 0.3  # 82% of it
    assert covered_cells(alpha, (1, 16, 16))[0, 0].nonzero().flatten().tolist() == [0, 1, 2]
    alpha = torch.zeros(1, 64, 64)
    alpha[:, :, 6:9] = 1.0  # thinner than a cell, in two columns of cells
    assert covered_cells(alpha, (1, 16, 16))[0, 0].nonzero().flatten().tolist() == [1, 2]
