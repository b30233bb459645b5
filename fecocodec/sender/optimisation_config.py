"""Configuration of the latent optimisation: number and size of the steps, objective, and presets of `--effort`."""

import math
from dataclasses import dataclass, replace

from fecocodec.container.detail_section import MAX_DETAIL_STEP
from fecocodec.container.lambda_quantisation import LAMBDA_MAX, LAMBDA_Q_MAX, STEPS_PER_E
from fecocodec.errors import InputError
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.distortion import Distortion, LogDistortion

DETAIL_LAMBDA_Q = 1179  # lambda 1e-3: from it on a few views have no detail; below it, detail gets more steps
FULL_DETAIL_LAMBDA_Q = 871  # lambda 3e-4: above it, bits of detail cost more, so that files near 1e-3 have few of them
DETAIL_PRICE_EXPONENT = 1.15  # of lambda there, beyond the exponent of the price
FINE_LAMBDA_Q = 589  # lambda 1e-4: below it, detail is quantised more finely


@dataclass(frozen=True)
class OptimisationConfig:
    """Number and size of the steps, and the objective.

    num_steps: number of steps for the last stage; stage 1 of two gets half of them plus one. extra_step_below: one step
    is added for each of these values that exceeds the quantised lambda. extra_step_above: one step is added for each of
    these values that the quantised lambda exceeds, unless the scene has more than `large_pixels`. num_steps_large:
    replaces `num_steps` for these. max_pixels: larger scenes get no steps: gradients at this size take encoding
    from 2.1 to 4.4 GiB. Pixels are counted over all views on the coding grid.

    step_size, step_size_unscaled: RMS of the first step, in quantisation steps and in units of y / gain. The larger of
    the two is used: the first limits the bits that a step adds, the second takes over when quantisation is fine.

    rate_weight, price_exponent: the price of a bit per pixel is rate_weight * lambda at lambda = 1e-2, and proportional
    to lambda ** price_exponent below. An exponent under 1 corrects for overfitting: D sees only the context views,
    which gain more per bit than views between them, and the more so the smaller lambda is.

    held_weight, max_steps_unheld: with more steps than max_steps_unheld, changes of the renderings between the context
    views are penalised with this weight, because many steps overfit the context views.

    detail_steps: steps of the detail layer just below lambda 1e-3; 0 for no such layer. detail_steps_per_decade: more
    steps for each power of ten that lambda is below; none for scenes with more than `large_pixels`. many_views,
    detail_steps_many: from this number of views on, there is detail at every lambda, with so many more steps; views
    that contradict each other gain more from it than from finer latents. detail_step: its quantisation step at lambda
    1e-4 and above; below, it is proportional to lambda ** detail_step_exponent.
    least_latent_lambda_q: latents below the detail layer are not coded at a smaller lambda.

    sharpness: -1 to 1. 0: the usual network proposes the steps; 1: the one for sharper pictures; between, a blend of
    their weights; below 0, as far to the other side. More gives sharper pictures and larger files.

    max_views_of_direct_gradients: with more views, gradients also pass through the residual branches of the predictor.
    ssim_stride: stride of the SSIM windows, see `metrics.ssim`. distortion: D of the objective.
    """

    num_steps: int = 4
    extra_step_below: tuple[int, ...] = (944, 256, 256, 256)  # lambda 4e-4 and, for three steps, 2.7e-5
    extra_step_above: tuple[int, ...] = (1356, 1356)  # lambda 2e-3
    num_steps_large: int = 2
    large_pixels: int = 2**19
    max_pixels: int = 2**22
    step_size: float = 0.12
    step_size_unscaled: float = 0.055
    rate_weight: float = 2.15
    price_exponent: float = 0.6
    held_weight: float = 0.5
    max_steps_unheld: int = 8
    sharpness: float = 0.0
    max_views_of_direct_gradients: int = 4
    ssim_stride: int = 3
    detail_steps: int = 4
    detail_steps_per_decade: int = 8
    many_views: int = 4
    detail_steps_many: int = 4
    detail_step: float = 0.3
    detail_step_exponent: float = 0.15
    least_latent_lambda_q: int = 1088  # lambda 7e-4
    distortion: Distortion = LogDistortion()  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        """Raise InputError for a sharpness that is not in [-1, 1], or that no step can bring about."""
        if not -1.0 <= self.sharpness <= 1.0:
            raise InputError(f"sharpness is {self.sharpness:g}; it must be from -1 to 1.")
        if self.sharpness != 0.0 and self.num_steps == 0:
            raise InputError(
                f"sharpness {self.sharpness:g} needs steps, which `effort` fast does not take; choose another."
            )

    def steps_of_last(self, num_pixels: int, lambda_q: int) -> int:
        """Return the number of steps of the last stage. num_pixels: of all views. lambda_q: quantised lambda."""
        if num_pixels > self.max_pixels:
            return 0
        num_steps = self.num_steps_large
        if num_pixels <= self.large_pixels:
            num_steps = self.num_steps + sum(lambda_q > bound for bound in self.extra_step_above)
        return num_steps + sum(lambda_q < bound for bound in self.extra_step_below)

    def detail_steps_of(self, num_views: int, num_pixels: int, lambda_q: int) -> int:
        """Return the number of steps of the detail layer; 0 for none. Other arguments as for `steps_of_last`."""
        has_many = num_views >= self.many_views
        if num_pixels > self.max_pixels or self.detail_steps == 0 or (lambda_q >= DETAIL_LAMBDA_Q and not has_many):
            return 0
        num_steps = self.detail_steps + (self.detail_steps_many if has_many else 0)
        if num_pixels > self.large_pixels:
            return num_steps
        return num_steps + round(self.detail_steps_per_decade * _decades_below(DETAIL_LAMBDA_Q, lambda_q))

    def detail_step_of(self, lambda_q: int) -> int:
        """Return the index of the quantisation step of the detail layer (FORMAT.md, section 8)."""
        step = self.detail_step * 10.0 ** (-self.detail_step_exponent * _decades_below(FINE_LAMBDA_Q, lambda_q))
        return min(MAX_DETAIL_STEP, max(0, round(-8.0 * math.log2(step))))

    def latent_lambda_q(self, lambda_q: int) -> int:
        """Return the quantised lambda of the latents of a stream with detail."""
        return max(lambda_q, self.least_latent_lambda_q)

    def with_steps(self, num_steps: int) -> "OptimisationConfig":
        """Return a copy with exactly `num_steps` steps, for all scenes of up to `max_pixels`."""
        changed = replace(
            self, num_steps=num_steps, num_steps_large=num_steps, extra_step_below=(), extra_step_above=()
        )
        return changed if num_steps else replace(changed, detail_steps=0)


def _decades_below(bound: int, lambda_q: int) -> float:
    """Return by how many powers of ten lambda is below that of `bound`, at least 0. Both are quantised."""
    return max(0, bound - lambda_q) / (STEPS_PER_E * math.log(10.0))


DEFAULT = OptimisationConfig()
FAST = DEFAULT.with_steps(0)
BEST = replace(DEFAULT.with_steps(16), num_steps_large=6, detail_steps=12, detail_steps_per_decade=16)
EFFORTS = {"fast": FAST, "default": DEFAULT, "best": BEST}


def config_of_effort(effort: "str | OptimisationConfig", sharpness: float = 0.0) -> OptimisationConfig:
    """Return the preset with this name, with a sharpness other than 0 if it is given; a configuration is kept as it is.

    Raises InputError for unknown names and for a sharpness that is not possible.
    """
    if isinstance(effort, OptimisationConfig):
        return replace(effort, sharpness=sharpness) if sharpness else effort
    if effort not in EFFORTS:
        raise InputError(f"there is no effort '{effort}'; choose one of {', '.join(EFFORTS)}.")
    return replace(EFFORTS[effort], sharpness=sharpness)


def steps_of_first(num_steps: int) -> int:
    """Return the number of steps of stage 1 if stage 2 has `num_steps`. Stage 2 corrects the remaining errors."""
    return min(num_steps, num_steps // 2 + 1)


def price_of_rate(config: OptimisationConfig, lambda_q: int) -> float:
    """Return the price of a bit per pixel, in units of D. The lambda of stage 1 may exceed 1e-2."""
    return config.rate_weight * LAMBDA_MAX * math.exp(config.price_exponent * (lambda_q - LAMBDA_Q_MAX) / STEPS_PER_E)


def price_of_detail(config: OptimisationConfig, num_views: int, lambda_q: int) -> float:
    """Return the price of a bit of detail per pixel, in units of D.

    At lambda 1e-3 and above, latents of a few views buy more at target views; below 3e-4, both buy the same, and detail
    far more at context views.
    """
    if num_views >= config.many_views:
        return price_of_rate(config, lambda_q)
    rise = math.exp(DETAIL_PRICE_EXPONENT * max(0, lambda_q - FULL_DETAIL_LAMBDA_Q) / STEPS_PER_E)
    return price_of_rate(config, lambda_q) * rise


def step_size(config: OptimisationConfig, condition: RateCondition) -> float:
    """Return the RMS of the first step, in quantisation steps."""
    return max(config.step_size, config.step_size_unscaled * float(condition.latent_gain[0]))
