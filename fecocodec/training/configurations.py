"""Named configurations of `fecosplat train`, and settings of a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from fecocodec.config import (
    COMPACT_SENDER,
    PAPER,
    PAPER_RECEIVER,
    PAPER_SENDER,
    CodecConfig,
    LargeSenderConfig,
    PaperSenderConfig,
    ReceiverConfig,
    SenderConfig,
)
from fecocodec.container.lambda_quantisation import LAMBDA_MAX, LAMBDA_MIN, quantise_lambda
from fecocodec.errors import InputError
from fecocodec.sender.distortion import Distortion, LogDistortion, MseDistortion, PerceptualDistortion
from fecocodec.training.batch import BatchShapes
from fecocodec.training.chunk_scenes import DL3DV, REALESTATE10K, VideoProtocol
from fecocodec.training.optimisation import OptimiserConfig, Schedule

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Configuration:
    """Everything that determines a training run, except its data and its seed.

    shapes: of the batches of each process. lambda_range: least and largest lambda; log(lambda) is uniform between them.
    precision: of convolutions and matrix products (see `sender.precision`). frozen: parts that are not trained (see
    `fine_tuning`). distortion: D of the loss.
    perceptual_weight: of ST-LPIPS beside D, for all networks and for the step network. More of it gives sharper
    pictures of lower PSNR (docs/what_we_learned.md).
    kept_batches: number of batches that each process keeps in memory with the features of a frozen extractor, 0: none.
    alone_every: the last of so many steps codes stage 1 alone, 0: none does. optimised_share: share of the steps whose
    latents are optimised before coding, as in encoding; they train the receiver and the network that proposes steps.
    optimiser: parameters of the optimiser. protocol: choice of the frames of chunks, None for our own (see
    `ChunkScenes`).

    The method and the number of stages are fields of `receiver`, because sender, receiver and `eval` need them too.
    With the method "paper", the loss and the coding of latents are the paper's.

    Raises InputError if lambda_range is empty or exceeds that of the codec, if features are kept of an extractor that
    is trained, if latents are to be optimised but the sender has no network that proposes steps, and if a field is set
    that the loss of the method ignores.
    """

    shapes: BatchShapes
    schedule: Schedule
    lambda_range: tuple[float, float] = (LAMBDA_MIN, LAMBDA_MAX)
    precision: Precision = "float32"
    receiver: ReceiverConfig = field(default_factory=ReceiverConfig)
    sender: CodecConfig = field(default_factory=SenderConfig)
    frozen: tuple[str, ...] = ()
    distortion: Distortion = MseDistortion()  # noqa: RUF009 - frozen
    perceptual_weight: float = 0.0
    kept_batches: int = 0
    alone_every: int = 8
    optimised_share: float = 0.0
    optimiser: OptimiserConfig = OptimiserConfig()  # noqa: RUF009 - frozen
    protocol: VideoProtocol | None = None

    def __post_init__(self) -> None:
        lowest, highest = self.lambda_q_range
        if lowest > highest:
            raise InputError(
                f"The range of lambda goes from {self.lambda_range[0]:g} down; give the smaller end first."
            )
        if self.kept_batches and not {"extractor", "matching"} & set(self.frozen):
            raise InputError(
                "Features can be kept only while the extractor or its matching is frozen; add one of them to `frozen`, "
                "or keep none."
            )
        if self.optimised_share and not self.sender.step_channels:
            raise InputError(
                "Latents are optimised by a network that proposes steps, which this configuration does not have; leave "
                "out `optimised_share`, or choose the configuration compact."
            )
        loss_options = {
            "perceptual_weight": self.perceptual_weight > 0,
            "disparity_weight": any(self.schedule.disparity_weight),
            "optimised_share": self.optimised_share > 0,
        }
        ignored = [f"`{name}`" for name, is_set in loss_options.items() if is_set]
        if self.is_paper and ignored:
            raise InputError(f"The paper's loss is D + lambda R and ignores {', '.join(ignored)}; leave them out.")

    @property
    def is_paper(self) -> bool:
        """Whether the method is the paper's."""
        return self.receiver.method == PAPER

    def with_perceptual(self, name: str) -> PerceptualDistortion:
        """Return D of the paper's loss with another perceptual distance.

        Raises InputError for another name, and if the loss of this configuration is not the paper's.
        """
        if not isinstance(self.distortion, PerceptualDistortion):
            raise InputError(
                "The loss of this configuration has no LPIPS; leave out `perceptual`, or weigh ST-LPIPS by "
                "`perceptual_weight`."
            )
        return replace(self.distortion, perceptual=name)

    @property
    def lambda_q_range(self) -> tuple[int, int]:
        """`lambda_range` in the fixed point of streams."""
        return quantise_lambda(self.lambda_range[0]), quantise_lambda(self.lambda_range[1])


# As published (paper, implementation details): 300,000 steps of four scenes, one in each of four processes. The
# learning rate of the pretrained ViT is that of DepthSplat's published training, 2e-6.
_PAPER_SCHEDULE = Schedule(
    num_steps=300_000,
    learning_rate=2e-4,
    warm_up=1,
    photograph_share=(1.0, 1.0),
    disparity_weight=(0.0, 0.0),
)
_PAPER_OPTIMISER = OptimiserConfig(betas=(0.9, 0.999), weight_decay=0.01, average_decay=0.0, backbone_share=0.01)
_NARROW_LAMBDAS = (LAMBDA_MIN, 1e-3)

_PAPER_RE10K = Configuration(
    shapes=BatchShapes(num_scenes=1, view_shares=((2, 1.0),), num_target=4, sizes=((256, 256),)),
    schedule=_PAPER_SCHEDULE,
    precision="bfloat16",
    receiver=PAPER_RECEIVER,
    sender=PAPER_SENDER,
    distortion=PerceptualDistortion(),
    alone_every=0,
    optimiser=_PAPER_OPTIMISER,
    protocol=REALESTATE10K,
)
_PAPER_DL3DV = replace(
    _PAPER_RE10K,
    shapes=BatchShapes(num_scenes=1, view_shares=((8, 1.0),), num_target=4, sizes=((256, 448),)),
    lambda_range=_NARROW_LAMBDAS,
    receiver=replace(PAPER_RECEIVER, lambda_range=_NARROW_LAMBDAS),
    sender=replace(PAPER_SENDER, matching_scale=2),
    protocol=DL3DV,
)
_ABLATION_STEPS = 100_000  # of every variant (paper, ablation study)


def _ablation(**changes: object) -> Configuration:
    """Return `paper-re10k` with 100,000 steps and other fields of the receiver, or with `sender`.

    Widths stay, so the number of parameters changes a little with the number of Gaussians.
    """
    schedule = replace(_PAPER_SCHEDULE, num_steps=_ABLATION_STEPS)
    sender = changes.pop("sender", _PAPER_RE10K.sender)
    receiver = replace(PAPER_RECEIVER, **changes)  # type: ignore[arg-type]
    return replace(_PAPER_RE10K, schedule=schedule, receiver=receiver, sender=sender)  # type: ignore[arg-type]


_COMPACT = Configuration(
    shapes=BatchShapes(
        num_scenes=2,
        view_shares=((2, 0.66), (3, 0.08), (4, 0.15), (6, 0.04), (8, 0.07)),
        num_target=2,
        sizes=((128, 128), (96, 160), (160, 96), (96, 128), (160, 160), (128, 192)),
    ),
    schedule=Schedule(num_steps=9_000, one_stage_until=1_000, bypass_until=1_400),
    distortion=LogDistortion(),
    sender=COMPACT_SENDER,
)

CONFIGURATIONS: Mapping[str, Configuration] = MappingProxyType(
    {
        "compact": _COMPACT,
        # Our method with the paper's extractor, for the receivers of compact models.
        "compact-re10k": Configuration(
            shapes=_PAPER_RE10K.shapes,
            schedule=replace(_PAPER_SCHEDULE, one_stage_until=5_000, bypass_until=15_000, warm_up=2_000),
            precision="bfloat16",
            sender=PaperSenderConfig(),
        ),
        "paper-re10k": _PAPER_RE10K,
        "paper-dl3dv": _PAPER_DL3DV,
        # The paper's larger variant: a frozen extractor through the adapter (`sender/extractors/adapter.py`), whose
        # weights are loaded from its checkpoint; the rest starts from the model of paper-dl3dv.
        "paper-dl3dv-large": replace(
            _PAPER_DL3DV,
            schedule=replace(_PAPER_SCHEDULE, num_steps=150_000),
            sender=LargeSenderConfig(),
        ),
        "ablate-no-context": _ablation(sender=replace(PAPER_SENDER, ablation="no-context")),
        "ablate-no-feedback": _ablation(sender=replace(PAPER_SENDER, ablation="no-feedback")),
        "ablate-gaussians-quarter": _ablation(gaussians_per_side=1),
        "ablate-gaussians-half": _ablation(gaussians_per_side=2),
        "ablate-gaussians-full": _ablation(gaussians_per_side=4),
        "ablate-iterations-1": _ablation(num_stages=1),
        "ablate-iterations-2": _ablation(num_stages=2),
        "ablate-iterations-3": _ablation(num_stages=3),
    }
)


def configuration_named(name: str) -> Configuration:
    """Return the configuration of this name. Raises InputError if there is none."""
    if name not in CONFIGURATIONS:
        raise InputError(f"There is no training configuration '{name}'; choose one of {', '.join(CONFIGURATIONS)}.")
    return CONFIGURATIONS[name]


@dataclass(frozen=True)
class RunSettings:
    """Where and how long a run trains, and what it writes; what it trains is in the configuration.

    max_minutes: save and stop after this time; None for no limit. device: where the networks run, `cpu` or `cuda:N`;
    batches are drawn on the CPU. num_workers: processes that draw batches ahead; with 0 the training process does.
    validate_every, keep_every: steps between validations, and between checkpoints that are kept, with a number.
    validation_scenes: number of validation scenes. origin: name of the configuration, seed and digests of the inputs,
    which a run must have again to be resumed.
    """

    folder: Path
    configuration: Configuration
    max_minutes: float | None
    seed: int = 0
    device: str = "cpu"
    log_every: int = 50
    save_every_minutes: float = 5.0
    samples_every_minutes: float = 15.0
    num_workers: int = 0
    validate_every: int = 5_000
    validation_scenes: int = 8
    keep_every: int = 25_000
    origin: Mapping[str, str] = field(default_factory=dict)
