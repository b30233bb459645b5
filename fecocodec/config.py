"""Configurations of the networks, stored in weights files. The model id of a stream therefore determines them."""

import math
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from fecocodec.grid import PER_CELL

MAX_GROWTH = 8  # largest ratio of a size to its default, so that a damaged file cannot allocate gigabytes
MAX_SIZE_WITHOUT_DEFAULT = 4096
MAX_FLOAT_GROWTH = 1000.0
# Metadata of fields that weights files of released models do not have. They are stored only if they differ from their
# default, so that the files, and with them the model ids, of released models stay the same.
OPTIONAL = {"optional": True}
COMPACT, PAPER = "compact", "paper"  # methods
NO_CONTEXT, NO_FEEDBACK = "no-context", "no-feedback"  # ablations of the sender, see `sender/ablations.py`


@dataclass(frozen=True)
class Method:
    """What a method does beside the paper's two stages; the defaults are this codec's own.

    has_rules: opacities, colours and layers follow `splatting.emission`. has_steps: latents and detail are optimised,
    views are faded. has_symbol_choice: symbols are chosen by rate and distortion, not rounded. stage_1_offset: of the
    quantised lambda of stage 1 of two, in units of the header (EXCESS_UNIT steps each). has_depth_feedback: E_fb gets
    depth errors, and differences of pictures in place of pictures.
    has_conditioned_adapter: the adapter of a third-party extractor depends on lambda. gaussians_per_side: of a cell of
    the 1/4 grid, as allowed. max_sh_degree: of the harmonics that P predicts.
    """

    has_rules: bool = True
    has_steps: bool = True
    has_symbol_choice: bool = True
    stage_1_offset: int = 229  # a factor of 6: stage 2 corrects the errors of stage 1, so its bits are worth less
    has_depth_feedback: bool = True
    has_conditioned_adapter: bool = False
    gaussians_per_side: tuple[int, ...] = (PER_CELL,)
    max_sh_degree: int = 0


METHODS = {
    COMPACT: Method(),
    PAPER: Method(False, False, False, 0, False, True, gaussians_per_side=(1, 2, 4), max_sh_degree=2),
}


@dataclass(frozen=True)
class ReceiverConfig:
    """Configuration of the receiver's networks."""

    state_channels: int = 128  # C of the paper: features, S0..S2, at 1/4 resolution
    latent_channels: int = 32  # y, at 1/8 resolution
    hyper_channels: int = 16  # z, at 1/32 resolution
    synthesis_channels: int = 168  # inner width of g_s at 1/8
    synthesis_depth: int = 2
    fine_hidden: int = 96  # inner width of the blocks at 1/4 resolution
    predictor_channels: tuple[int, int] = (176, 264)  # widths of P at 1/8 and 1/16
    num_neighbours: int = 24  # k of the KNN attention
    neighbour_fade: float = 1.0  # range over which weights fall to 0, as a share of neighbour k + 1's squared distance
    attention_channels: int = 48
    # The quantisation step of latents is 1 / gain. With rounding to nearest, the squared error grows with the square of
    # the step and the bits fall with its logarithm, so the optimal step for D + lambda R is proportional to
    # sqrt(lambda). Rate-distortion optimised quantisation (`coding/symbol_choice.py`) favours slightly finer steps.
    largest_gain: float = 9.1206  # of latents at lambda 1e-5
    gain_exponent: float = 0.4
    # Free-space check (`splatting/free_space.py`).
    free_space_colour: float = 0.12  # squared distance of sRGB colours in [0, 1] that gives half of a violation
    free_space_lead: float = 0.1  # logarithm of the ratio of depths that gives half of a violation: 10% nearer
    free_space_lead_width: float = 0.07
    # Free-space check with three or more views.
    free_space_protection: float = 0.5  # reduction of a violation of a confirmed Gaussian by an unconfirmed surface
    free_space_strictness: float = 2.0  # exponent of the ratio of two views' confirmation, scales free_space_colour
    near_bound_depth: float = 0.7  # depth in another view, in units of near, that gives half of a violation
    near_bound_width: float = 0.05  # width of this transition, in the logarithm of depth
    near_bound_margin: float = 0.5  # extension of the other view's image, as a share of its sides
    # View-dependent colours (`splatting/view_dependence.py`).
    view_dependence: float = 0.5  # share of the colour difference to another view that the fitted slope reproduces
    view_dependence_ridge: float = 0.1  # ridge, as the difference of unit directions that halves the slope
    hiding_lag: float = 0.1  # logarithm of the ratio of depths at half occlusion: 10% behind the surface
    hiding_lag_width: float = 0.05
    # Fading of duplicates with three or more views (`splatting/duplicates.py`).
    duplicate_lead: float = field(default=0.15, metadata=OPTIONAL)  # logarithm of the ratio of depths that gives 1/e
    duplicate_width: float = field(default=0.05, metadata=OPTIONAL)  # of the transition, in log of the ratio of sizes
    # Method: "paper" switches off what this codec adds to the paper (docs/paper_profile.md).
    method: str = field(default=COMPACT, metadata=OPTIONAL)
    gaussians_per_side: int = field(default=PER_CELL, metadata=OPTIONAL)  # of a cell of the 1/4 grid: 1, 2 or 4
    sh_degree: int = field(default=0, metadata=OPTIONAL)  # of the harmonics that P predicts, in each camera's frame
    lambda_range: tuple[float, float] = field(default=(1e-5, 1e-2), metadata=OPTIONAL)  # that the model was trained for
    num_stages: int = field(default=2, metadata=OPTIONAL)  # likewise; streams hold at most two
    prior_channels: int = field(default=64, metadata=OPTIONAL)  # inner width of the entropy model
    # Whether the entropy model of stage 2 gets zeros in place of y_hat of stage 1, as in the paper.
    codes_stages_apart: bool = field(default=False, metadata=OPTIONAL)
    detail_planes: int = field(default=0, metadata=OPTIONAL)  # numbers of the detail layer for a block; 0 for no layer

    @property
    def kind(self) -> Method:
        """Return what the method does. Raises KeyError for a method that does not exist, see `Receiver`."""
        return METHODS[self.method]


CODEC_CHANNELS = 128  # of the main blocks of g_a and g_s (paper, codec configuration)
# z has as many channels as y (paper: the entropy model operates on 32). P has the rest of the published 3.45 M.
PAPER_RECEIVER = ReceiverConfig(
    hyper_channels=32,
    synthesis_channels=CODEC_CHANNELS,
    synthesis_depth=3,
    predictor_channels=(184, 264),
    method=PAPER,
    sh_degree=2,  # of DepthSplat
    codes_stages_apart=True,
)


@dataclass(frozen=True)
class CodecConfig:
    """Sizes of g_a and E_fb, common to all feature extractors.

    extractor: name of the feature extractor in weights files. ablation: "no-context" gives g_a the state S0 in stage 2,
    "no-feedback" gives E_fb the photographs in place of the renderings; both, separated by a space, or "" for neither.
    step_channels: width of the network that proposes the steps of latent optimisation; 0 for steps along the gradient.
    has_sharp_steps: whether there is a second one, for sharper pictures.
    """

    extractor: ClassVar[str]
    analysis_channels: int = 160  # inner width of g_a at 1/8
    fine_hidden: int = 96
    ablation: str = field(default="", metadata=OPTIONAL, kw_only=True)
    step_channels: int = field(default=0, metadata=OPTIONAL, kw_only=True)
    has_sharp_steps: bool = field(default=False, metadata=OPTIONAL, kw_only=True)


@dataclass(frozen=True)
class SenderConfig(CodecConfig):
    """Sizes of the sender with the compact feature extractor."""

    extractor: ClassVar[str] = "compact"
    num_candidates: int = 48  # inverse depths of the plane sweep
    matching_channels: int = 48
    stem_channels: int = 96
    fusion_channels: tuple[int, int, int] = (128, 192, 256)  # at 1/4, 1/8, 1/16
    attention_channels: int = 128
    num_source_views: int = 2  # other views against which a view is matched


COMPACT_SENDER = SenderConfig(step_channels=96)  # the sender that is trained; what ships has sharp steps, too


@dataclass(frozen=True)
class PaperSenderConfig(CodecConfig):
    """Configuration of the paper's sender. The sizes of its extractor are those of the public checkpoints.

    geometry: "public" or "exact", see `depthsplat_small`. matching_scale: 2 for a cost volume at 1/8 resolution.
    """

    extractor: ClassVar[str] = "depthsplat-small"
    geometry: str = "public"
    matching_scale: int = 1


PAPER_SENDER = PaperSenderConfig(analysis_channels=CODEC_CHANNELS)


@dataclass(frozen=True)
class AdaptedSenderConfig(CodecConfig):
    """Configuration of a sender with an external feature extractor; see `sender/extractors/adapter.py`."""

    extractor: ClassVar[str] = "adapted"
    fingerprint: str = ""  # hash of the extractor's weights
    extractor_channels: int = 0


@dataclass(frozen=True)
class LargeSenderConfig(CodecConfig):
    """Configuration of the paper's larger sender: DepthSplat-Base, frozen, through the adapter.

    weights: path of the extractor's checkpoint, which is loaded from there. fingerprint: digest of its tensors.
    """

    extractor: ClassVar[str] = "depthsplat-base"
    analysis_channels: int = CODEC_CHANNELS
    fingerprint: str = ""
    weights: str = ""


def stored_fields(config: Any) -> dict[str, Any]:
    """Return the fields of a configuration that a weights file stores: optional ones only if they are not default."""
    values = {entry.name: (getattr(config, entry.name), entry.default) for entry in fields(config)}
    optional = optional_fields(config)
    return {name: value for name, (value, default) in values.items() if name not in optional or value != default}


def optional_fields(config: Any) -> frozenset[str]:
    """Return the names of the fields that a weights file may lack."""
    return frozenset(entry.name for entry in fields(config) if entry.metadata.get("optional"))


def is_in_range(value: object, default: object) -> bool:
    """Return whether the value of a configuration's field is in the range that the field's default implies.

    Integers: 1 to MAX_GROWTH times the default, or 0 to MAX_SIZE_WITHOUT_DEFAULT if the default is 0. Floats: finite,
    above 0, at most MAX_FLOAT_GROWTH times the default. Strings are always accepted; the network that uses them checks
    them.
    """
    if isinstance(value, tuple) and isinstance(default, tuple):
        return all(map(is_in_range, value, default))
    if isinstance(value, int) and isinstance(default, int):
        return 1 <= value <= MAX_GROWTH * default if default else 0 <= value <= MAX_SIZE_WITHOUT_DEFAULT
    if isinstance(value, float) and isinstance(default, float):
        return math.isfinite(value) and 0 < value <= MAX_FLOAT_GROWTH * default
    return True
