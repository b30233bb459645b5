"""What the sender renders and optimises is what `decode` emits, rule by rule; what it leaves out is named."""

from dataclasses import replace

import pytest
import torch

from fecocodec.coding.camera_packing import unpack
from fecocodec.coding.visibility import is_filled_behind, visibility_of
from fecocodec.container import quantise_lambda, read_stream, write_stream
from fecocodec.geometry.gaussian_arrays import ALPHA_MIN
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import decode_with
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.coverage import BLACK, WHITE
from fecocodec.sender.encode import assemble, write_stages
from fecocodec.sender.latent_optimisation import gaussians_of
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from tests.example_scenes import synthetic_views

SIZE = (64, 96)


def views_of(count: int, is_cut_out: bool) -> Views:
    views = synthetic_views(count, 0, SIZE, seed=count)
    if not is_cut_out:
        return views
    opacity = torch.zeros(count, *SIZE)
    opacity[:, 16:48, 16:80] = 1.0
    return replace(views, images=views.images * opacity[:, None] + 1.0 - opacity[:, None], alpha=opacity)


@torch.no_grad()
@pytest.mark.parametrize(("count", "is_cut_out"), [(2, False), (4, False), (8, False), (2, True), (4, True)])
def test_feedback_and_objective_show_what_is_decoded(shipped_codec: Codec, count: int, is_cut_out: bool) -> None:
    views = views_of(count, is_cut_out)
    scene = prepare_scene(views, shipped_codec.device)
    encoder = SceneEncoder.of(shipped_codec, scene)
    stages = write_stages(encoder, quantise_lambda(1e-3), 2, DEFAULT.with_steps(1))
    stream = assemble(shipped_codec, scene, stages)
    last, data, shown_on = stages[-1], write_stream(stream), WHITE if is_cut_out else BLACK
    prediction = encoder.predict(last.state, last.inputs.condition)
    sent = encoder.emit(prediction, last.fading)
    assert torch.equal(encoder.render(last).scenes[0].color, render(sent, scene.cameras.scene(0), SIZE, shown_on).color)
    optimised = gaussians_of(encoder, replace(last.inputs, fading=last.fading), last.coded.y_hat)

    _, frame = normalise_scene(unpack(scene.packed))

    def decoded(sh_degree: int) -> Gaussians:
        """What `decode` emits, in the normalised frame: Gaussians of the views, layers outside and behind."""
        emitted = decode_with(shipped_codec.receiver, data, sh_degree=sh_degree, merging=None).gaussians
        means = ((emitted.means.double() - torch.from_numpy(frame.origin)) / frame.scale).float()
        return replace(emitted, means=means, scales=emitted.scales / frame.scale)

    per_view = prediction.attributes.opacity.numel()
    for mine, theirs in ((sent, decoded(1)), (optimised, decoded(0))):
        number = torch.arange(mine.count)
        drawn = mine.keep((number < per_view) & (mine.opacities >= ALPHA_MIN))
        behind = mine.keep(number >= per_view)
        of_views = torch.arange(theirs.count) < drawn.count
        of_layer = torch.arange(theirs.count) >= theirs.count - behind.count
        for ours, received in ((drawn, theirs.keep(of_views)), (behind, theirs.keep(of_layer))):
            for one, other in zip(ours.fields(), received.fields(), strict=True):
                torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)
    is_filled = is_filled_behind(count, is_cut_out)
    assert (sent.count > per_view) == (optimised.count > per_view) == is_filled
    visibility = visibility_of(read_stream(data))
    assert (visibility is not None) == (is_cut_out or (last.fading is not None and bool(last.fading.levels.any())))
