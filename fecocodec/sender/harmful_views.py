"""Find views that harm the others: their Gaussians hide what the other views show.

More photographs do not always give a better scene. Badly placed Gaussians of far views can lie in front of surfaces
that near views show well, and stage 2 then spends its bits on the difference. The views are judged after stage 1
without optimisation: each photograph is rendered from the Gaussians of the other views alone, because its own Gaussians
lie close to its camera and hide those of others. If the photographs are rendered better without the Gaussians of one
view, that view is left out, and the remaining views are judged again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.checkpoint import model_folder
from fecocodec.container import quantise_lambda
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.limits import MIN_SIDE, grid_side
from fecocodec.rendering.metrics import finite_psnr
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.encode import check_views
from fecocodec.sender.latent_coding import EstimatedLatent, estimate_bits
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Stage
from fecocodec.splatting.emission import Emission, emit

OnLeftOut = Callable[[tuple[str, ...]], None]  # (names of views)
LEAST_VIEWS = 5  # fewer views are not judged
# Chosen on captures that the weights were not trained on (docs/what_we_learned.md, More views).
LEAST_GAIN = 0.2  # dB by which the mean PSNR must rise without a view, for it to be left out
LEAST_SLOPE = 0.02  # dB, see `_Judgement`: a view of a smaller slope is not tried
NUM_TRIED = 3  # views, those with the largest slopes, of which one or none is left out
JUDGED_PIXELS = 128 * 128  # larger views are judged at about this size; 192 * 192 is slower and no better


def without_harmful_views(
    views: Views,
    *,
    lmbda: float = 1e-3,
    device: str = "cpu",
    model: Path | str | None = None,
    on_left_out: OnLeftOut = lambda _names: None,
) -> Views:
    """Return the views without those that make the reconstruction of the others worse, in the same order.

    lmbda, device, model: as for `encode`. on_left_out: called once with the names of the views that are left out, if
    there are any. Fewer than five views are returned unchanged. Raises InputError for views or a lambda that cannot be
    encoded, ModelError if weights cannot be loaded.
    """
    lambda_q = quantise_lambda(lmbda)
    check_views(views, num_stages=1)
    return without_harmful_views_with(load_codec(model_folder(model), device), views, lambda_q, on_left_out)


def without_harmful_views_with(codec: Codec, views: Views, lambda_q: int, on_left_out: OnLeftOut) -> Views:
    """Leave out with loaded networks. lambda_q: quantised lambda. Views must pass `check_views`. Raises InputError."""
    kept = helpful_views(codec, views, lambda_q)
    if left_out := tuple(name for view, name in enumerate(views.names) if view not in kept):
        on_left_out(left_out)
    return views.select(kept)


def left_out_note(names: Sequence[str]) -> str:
    """Return a sentence that says which views are left out, and how to keep them."""
    them = "it" if len(names) == 1 else "them"
    return f"left out {', '.join(names)}: the other views are better without {them}; to keep all, use `views=all`."


@torch.inference_mode(False)  # slopes need gradients
@torch.no_grad()
def helpful_views(codec: Codec, views: Views, lambda_q: int) -> list[int]:
    """Return the indices of the views that remain. Arguments as for `encode_with`. Raises InputError."""
    kept = list(range(len(views.images)))
    if len(kept) < LEAST_VIEWS:
        return kept
    trial = _Trial.of(codec, _at_judged_size(views), lambda_q)
    judgement = trial.judge(kept)
    while len(kept) >= LEAST_VIEWS and (better := _without_one(trial, kept, judgement)):
        kept, judgement = better
    return kept


def _without_one(trial: "_Trial", kept: list[int], judgement: "_Judgement") -> tuple[list[int], "_Judgement"] | None:
    """Return the views and their judgement without one whose absence is a gain, None if none is found."""
    slopes = judgement.slopes
    for view in sorted(kept, key=lambda view: -slopes[view])[:NUM_TRIED]:
        if slopes[view] < LEAST_SLOPE:
            break
        left = [other for other in kept if other != view]
        without = trial.judge(left)
        if without.psnr >= judgement.psnr + LEAST_GAIN:
            return left, without
    return None


@dataclass(frozen=True)
class _Judgement:
    """Quality of all photographs, each rendered from the Gaussians of the kept views other than its own.

    psnr: mean in dB. slopes: of each view, in dB: minus the derivative of the mean by a factor that multiplies the
    opacities of the view's Gaussians. A positive slope says that the photographs gain if these become fainter.
    """

    psnr: float
    slopes: list[float]


@dataclass(frozen=True)
class _Trial:
    """All views after stage 1, from which the Gaussians of some of the views can be predicted."""

    encoder: SceneEncoder
    stage: Stage[EstimatedLatent]

    @staticmethod
    def of(codec: Codec, views: Views, lambda_q: int) -> "_Trial":
        scene = prepare_scene(views, codec.device)
        encoder = SceneEncoder.of(codec, scene)
        (stage,) = encoder.run(torch.tensor([lambda_q]), 1, estimate_bits(codec))
        return _Trial(encoder, stage)

    @cached_property
    def photographs(self) -> Float[Tensor, "view 3 h w"]:
        return self.encoder.images[0]

    def judge(self, kept: list[int]) -> _Judgement:
        """Judge the Gaussians of these views, predicted as if only they had been coded."""
        gaussians, view_of = self._predict(kept)
        cameras, count = self.encoder.cameras.scene(0), self.encoder.num_views
        opacity = torch.ones(count, device=view_of.device, requires_grad=True)
        total, growth = 0.0, torch.zeros_like(opacity)
        for view in range(count):
            is_other = view_of != view
            with torch.enable_grad():
                others = gaussians.keep(is_other)
                others = replace(others, opacities=others.opacities * opacity[view_of[is_other]])
                color = render(others, cameras.select([view]), self.encoder.size, self.encoder.background).color
                quality = finite_psnr(color.clamp(0, 1), self.photographs[[view]])[0] / count
            total += float(quality)
            if others.count:
                growth += torch.autograd.grad(quality, opacity)[0]
        return _Judgement(total, (-growth).tolist())

    def _predict(self, kept: list[int]) -> tuple[Gaussians, Tensor]:
        """Return the Gaussians that a decoder would emit, and the index of the view of each."""
        receiver, cameras = self.encoder.codec.receiver, self.encoder.cameras.scene(0).select(kept)
        condition = receiver.condition(self.stage.inputs.lambda_q[kept], self.stage.inputs.stage)
        prediction = receiver.predict(self.stage.state[kept], cameras.as_batch(), condition)
        gaussians, cut_out = emit(prediction, cameras.as_batch(), receiver.config, Emission()), self.encoder.cut_out
        view_of = torch.tensor(kept, device=gaussians.means.device).repeat_interleave(gaussians.count // len(kept))
        if cut_out is None:
            return gaussians, view_of
        is_covered = cut_out.is_covered[kept].flatten()
        return gaussians.keep(is_covered), view_of[is_covered]


def _at_judged_size(views: Views) -> Views:
    """Return the views with about JUDGED_PIXELS pixels each, or as they are if they are not larger."""
    height, width = views.image_size
    scale = (JUDGED_PIXELS / (height * width)) ** 0.5
    if scale >= 1.0:
        return views
    size = [max(MIN_SIDE, grid_side(round(side * scale))) for side in (height, width)]
    images = F.interpolate(views.images.float(), size, mode="bicubic", antialias=True, align_corners=False)
    alpha = views.alpha
    if alpha is not None:
        alpha = F.interpolate(alpha[:, None].float(), size, mode="area")[:, 0]
    return replace(views, images=images.clamp(0, 1), alpha=alpha)
