"""Configuration of the optimisation: numbers of steps, objective, and presets of `--effort`."""

from dataclasses import dataclass, replace

from fecocodec.errors import InputError
from fecocodec.sender.distortion import Distortion, LogDistortion
from fecocodec.sender.lambda_roles import DETAIL_LAMBDA_Q, MANY_VIEWS, decades_below


@dataclass(frozen=True)
class OptimisationConfig:
    """Numbers of steps, and the objective. Pixels are counted over all context views on the coding grid.

    num_steps: number of steps for the last stage; see `steps_of_stages` for stage 1 of two. extra_step_below: one step
    is added for each of these values that exceeds the quantised lambda. extra_step_above: one step is added for each of
    these values that the quantised lambda exceeds, unless the scene has more than `large_pixels`. num_steps_large:
    replaces `num_steps` for these. max_pixels: larger scenes get no steps: gradients at this size take encoding
    from 2.1 to 4.4 GiB.

    detail_steps: steps of the detail layer just below lambda 1e-3; 0 for no such layer. detail_steps_per_decade: more
    steps for each power of ten that lambda is below; none for scenes with more than `large_pixels`. detail_steps_many:
    so many more from `MANY_VIEWS` views on, where there is detail at every lambda; views that contradict each other
    gain more from it than from finer latents.

    sharpness: -1 to 1. 0: the usual network proposes the steps; 1: the one for sharper pictures; between, a blend of
    their weights; below 0, as far to the other side. More gives sharper pictures and larger files.
    distortion: D of the objective.
    """

    num_steps: int = 4
    extra_step_below: tuple[int, ...] = (944, 256, 256, 256)  # lambda 4e-4 and, for three steps, 2.7e-5
    extra_step_above: tuple[int, ...] = (1356, 1356)  # lambda 2e-3
    num_steps_large: int = 2
    large_pixels: int = 2**19
    max_pixels: int = 2**22
    detail_steps: int = 4
    detail_steps_per_decade: int = 8
    detail_steps_many: int = 4
    sharpness: float = 0.0
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

    def steps_of_stages(self, num_pixels: int, lambda_q: int, *, is_taught: bool) -> tuple[int, int]:
        """Return the numbers of steps of stage 1 of two, and of the last stage. is_taught: see `lambda_roles`.

        Stage 2 corrects what stage 1 leaves. Where guides show what it should be, stage 1 needs a single step.
        """
        last = self.steps_of_last(num_pixels, lambda_q)
        return (1, last + 1) if is_taught and last > 0 else (steps_of_first(last), last)

    def detail_steps_of(self, num_views: int, num_pixels: int, lambda_q: int) -> int:
        """Return the number of steps of the detail layer; 0 for none. Other arguments as for `steps_of_last`."""
        has_many = num_views >= MANY_VIEWS
        if num_pixels > self.max_pixels or self.detail_steps == 0 or (lambda_q >= DETAIL_LAMBDA_Q and not has_many):
            return 0
        num_steps = self.detail_steps + (self.detail_steps_many if has_many else 0)
        if num_pixels > self.large_pixels:
            return num_steps
        return num_steps + round(self.detail_steps_per_decade * decades_below(DETAIL_LAMBDA_Q, lambda_q))

    def with_steps(self, num_steps: int) -> "OptimisationConfig":
        """Return a copy with exactly `num_steps` steps, for all scenes of up to `max_pixels`."""
        changed = replace(
            self, num_steps=num_steps, num_steps_large=num_steps, extra_step_below=(), extra_step_above=()
        )
        return changed if num_steps else replace(changed, detail_steps=0)


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
    """Return the number of steps of stage 1, without guides, if stage 2 has `num_steps`."""
    return min(num_steps, num_steps // 2 + 1)
