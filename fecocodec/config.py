"""Sizes of the networks. A stream's model id covers the weights, and so these numbers too."""

import math
from dataclasses import dataclass
from typing import ClassVar

MAX_GROWTH = 8  # of a size over its default, so that a damaged file cannot ask for networks of gigabytes
MAX_SIZE_WITHOUT_DEFAULT = 4096
MAX_FLOAT_GROWTH = 1000.0


@dataclass(frozen=True)
class ReceiverConfig:
    """What `decode` must know to build its networks; stored with the receiver's weights."""

    state_channels: int = 128  # C of the paper: features, S0..S2, at 1/4 resolution
    latent_channels: int = 32  # y, at 1/8 resolution
    hyper_channels: int = 16  # z, at 1/32 resolution
    synthesis_channels: int = 168  # inner width of g_s at 1/8
    synthesis_depth: int = 2
    fine_hidden: int = 96  # inner width of the blocks at 1/4 resolution
    predictor_channels: tuple[int, int] = (176, 264)  # widths of P at 1/8 and 1/16
    num_neighbours: int = 24  # k of the KNN attention
    neighbour_fade: float = 1.0  # share of the squared distance to the nearest point left out over which they fade
    attention_channels: int = 48
    # Quantisation steps are 1 / gain. Where rate and squared error trade off at price lambda the best step grows as the
    # root of lambda, if symbols are the nearest: squared error grows with the square of the step, bits fall with its
    # logarithm. Symbols that save bits (`coding/symbol_choice.py`) do better with somewhat finer steps.
    largest_gain: float = 9.1206  # of latents at lambda 1e-5
    gain_exponent: float = 0.4
    # What another view contradicts (`receiver/free_space.py`).
    free_space_colour: float = 0.12  # squared distance of sRGB colours in [0, 1] that gives half of a violation
    free_space_lead: float = 0.1  # logarithm of the ratio of depths that gives half of a violation: 10% nearer
    free_space_lead_width: float = 0.07
    # With three views or more.
    free_space_protection: float = 0.5  # share of a violation dropped where the Gaussian is confirmed, the surface not
    free_space_strictness: float = 2.0  # power of the ratio of two views' confirmation, a factor of free_space_colour
    near_bound_depth: float = 0.7  # of the near bound: depth in another view that gives half of a violation
    near_bound_width: float = 0.05  # of the logarithm of depth
    near_bound_margin: float = 0.5  # around the other view's image, as a share of its sides
    # Colours by direction (`receiver/view_dependence.py`).
    view_dependence: float = 0.5  # how far a colour goes towards what another view shows, seen from there
    view_dependence_ridge: float = 0.1  # difference of unit directions at which it goes half of that way
    hiding_lag: float = 0.1  # logarithm of the ratio of depths at which half is hidden: 10% behind what is shown
    hiding_lag_width: float = 0.05


@dataclass(frozen=True)
class CodecConfig:
    """Sizes of the sender's half of the codec (g_a, E_fb), whatever extracts its features.

    extractor: its name in weights files.
    """

    extractor: ClassVar[str]
    analysis_channels: int = 160  # inner width of g_a at 1/8
    fine_hidden: int = 96


@dataclass(frozen=True)
class SenderConfig(CodecConfig):
    """Sizes of the compact sender."""

    extractor: ClassVar[str] = "compact"
    num_candidates: int = 48  # inverse depths of the plane sweep
    matching_channels: int = 48
    stem_channels: int = 96
    fusion_channels: tuple[int, int, int] = (128, 192, 256)  # at 1/4, 1/8, 1/16
    attention_channels: int = 128
    num_source_views: int = 2  # nearest other views that a view is matched against


@dataclass(frozen=True)
class PaperSenderConfig(CodecConfig):
    """The paper's sender; the sizes of its extractor are those of the public checkpoints.

    geometry: "public" or "exact", see `depthsplat_small`. matching_scale: 2 for a cost volume at 1/8 resolution.
    """

    extractor: ClassVar[str] = "depthsplat-small"
    geometry: str = "public"
    matching_scale: int = 1


@dataclass(frozen=True)
class AdaptedSenderConfig(CodecConfig):
    """A sender around an extractor of others; see `sender/extractors/adapter.py`."""

    extractor: ClassVar[str] = "adapted"
    fingerprint: str = ""  # of the extractor's weights
    extractor_channels: int = 0


def is_in_range(value: object, default: object) -> bool:
    """Whether a field of a configuration can be used, judged by the default of the same field and type.

    Sizes: 1 to MAX_GROWTH times the default, or at most MAX_SIZE_WITHOUT_DEFAULT where the default is 0. Other numbers:
    finite, above 0, at most MAX_FLOAT_GROWTH times the default. Text is checked by the network that uses it.
    """
    if isinstance(value, tuple) and isinstance(default, tuple):
        return all(map(is_in_range, value, default))
    if isinstance(value, int) and isinstance(default, int):
        return 1 <= value <= MAX_GROWTH * default if default else 0 <= value <= MAX_SIZE_WITHOUT_DEFAULT
    if isinstance(value, float) and isinstance(default, float):
        return math.isfinite(value) and 0 < value <= MAX_FLOAT_GROWTH * default
    return True
