"""How latents are optimised: number and size of the steps, objective, and the presets of `--effort`."""

import math
from dataclasses import dataclass, replace

from fecocodec.container.lagrangian import LAMBDA_MAX, LAMBDA_Q_MAX, STEPS_PER_E
from fecocodec.errors import InputError
from fecocodec.layers.blocks import RateCondition
from fecocodec.sender.distortion import Distortion, LogDistortion


@dataclass(frozen=True)
class OptimisationConfig:
    """Number and size of the steps, and the objective.

    num_steps: for the last stage; a first stage that is not the last gets half as many and one. extra_step_below: one
    step more below each of these quantised lambdas, where bits alone improve little. num_steps_large: in place of
    `num_steps` for scenes of more than `large_pixels`. max_pixels: no step for larger scenes, whose gradients need
    several GiB. Pixels are those of all views on the coding grid.

    step_size, step_size_unscaled: root mean square of the first step, in quantisation steps and in latents divided by
    their gain; the longer one counts. The first bounds the bytes that a step adds, the second matters where
    quantisation is fine.

    rate_weight, price_exponent: a bit per pixel costs rate_weight * lambda at lambda 1e-2, and falls with lambda to the
    power price_exponent: context views, which alone are compared, gain more per bit than views between them, the more
    so the finer they are coded.

    held_weight, max_steps_unheld: with more steps than that, views between the context views are kept as they were
    before the first step, at this weight. Many steps overfit the context views.

    max_views_of_direct_gradients: for more views, gradients also pass the residual branches of the predictor.
    ssim_stride: 3 takes a quarter of the time of SSIM and changes it by less than a thousandth.
    """

    num_steps: int = 4
    extra_step_below: tuple[int, ...] = (944, 256)  # lambda 4e-4 and 2.7e-5
    num_steps_large: int = 1
    large_pixels: int = 2**19
    max_pixels: int = 2**20
    step_size: float = 0.12
    step_size_unscaled: float = 0.055
    rate_weight: float = 2.0
    price_exponent: float = 0.6
    held_weight: float = 0.5
    max_steps_unheld: int = 6
    max_views_of_direct_gradients: int = 4
    ssim_stride: int = 3
    distortion: Distortion = LogDistortion()  # noqa: RUF009 - frozen

    def steps_of_last(self, num_pixels: int, lambda_q: int) -> int:
        """Number of steps of the last stage of a scene with so many pixels, coded at this lambda."""
        if num_pixels > self.max_pixels:
            return 0
        num_steps = self.num_steps if num_pixels <= self.large_pixels else self.num_steps_large
        return num_steps + sum(lambda_q < bound for bound in self.extra_step_below)

    def with_steps(self, num_steps: int) -> "OptimisationConfig":
        """The same with exactly so many steps, unless the scene has more than `max_pixels`."""
        return replace(self, num_steps=num_steps, num_steps_large=num_steps, extra_step_below=())


DEFAULT = OptimisationConfig()
FAST = DEFAULT.with_steps(0)
BEST = replace(DEFAULT, num_steps=16, num_steps_large=4, extra_step_below=())
EFFORTS = {"fast": FAST, "default": DEFAULT, "best": BEST}


def config_of_effort(effort: "str | OptimisationConfig") -> OptimisationConfig:
    """The preset of this name, or the configuration itself. Raises InputError for a name that does not exist."""
    if isinstance(effort, OptimisationConfig):
        return effort
    if effort not in EFFORTS:
        raise InputError(f"there is no effort '{effort}'; choose one of {', '.join(EFFORTS)}.")
    return EFFORTS[effort]


def steps_of_first(num_steps: int) -> int:
    """Steps of stage 1 where stage 2 gets `num_steps`: stage 2 corrects what they leave."""
    return min(num_steps, num_steps // 2 + 1)


def price_of_rate(config: OptimisationConfig, lambda_q: int) -> float:
    """Price of a bit per pixel, in units of D; also for a stage-1 lambda above 1e-2."""
    return config.rate_weight * LAMBDA_MAX * math.exp(config.price_exponent * (lambda_q - LAMBDA_Q_MAX) / STEPS_PER_E)


def step_size(config: OptimisationConfig, condition: RateCondition) -> float:
    """Root mean square of the first step, in quantisation steps."""
    return max(config.step_size, config.step_size_unscaled * float(condition.latent_gain[0]))
