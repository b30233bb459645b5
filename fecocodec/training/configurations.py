"""Named configurations of `fecosplat train`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from fecocodec.config import CodecConfig, PaperSenderConfig, ReceiverConfig, SenderConfig
from fecocodec.container.lagrangian import LAMBDA_MAX, LAMBDA_MIN, quantise_lambda
from fecocodec.errors import InputError
from fecocodec.sender.distortion import Distortion, LogDistortion, MseDistortion
from fecocodec.training.batch_shapes import BatchShapes
from fecocodec.training.schedule import Schedule

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Configuration:
    """Everything that determines a training run, except its data and its seed.

    shapes: of the batches of each process. lambda_range: least and largest lambda; log(lambda) is uniform between them.
    precision: of convolutions and matrix products (see `sender.precision`). frozen: parts that are not trained (see
    `fine_tuning`). distortion: D of the loss.
    kept_batches: number of batches that each process keeps in memory with the features of a frozen extractor, 0: none.

    Raises InputError if lambda_range is empty or exceeds that of the codec, and if features are kept of an extractor
    that is trained.
    """

    shapes: BatchShapes
    schedule: Schedule
    lambda_range: tuple[float, float] = (LAMBDA_MIN, LAMBDA_MAX)
    precision: Precision = "float32"
    receiver: ReceiverConfig = field(default_factory=ReceiverConfig)
    sender: CodecConfig = field(default_factory=SenderConfig)
    frozen: tuple[str, ...] = ()
    distortion: Distortion = MseDistortion()  # noqa: RUF009 - frozen
    kept_batches: int = 0

    def __post_init__(self) -> None:
        lowest, highest = self.lambda_q_range
        if lowest > highest:
            raise InputError(
                f"The range of lambda goes from {self.lambda_range[0]:g} down; give the smaller end first."
            )
        if self.kept_batches and "extractor" not in self.frozen:
            raise InputError(
                "Features can be kept only while the extractor is frozen; add it to `frozen`, or keep none."
            )

    @property
    def lambda_q_range(self) -> tuple[int, int]:
        """`lambda_range` in the fixed point of streams."""
        return quantise_lambda(self.lambda_range[0]), quantise_lambda(self.lambda_range[1])


# As published (paper, implementation details): 300,000 steps of four scenes, one in each of four processes.
# The warm-up without a rate is ours: without it, feature codecs saturate (docs/training.md).
_PAPER_SCHEDULE = Schedule(
    num_steps=300_000,
    one_stage_until=5_000,
    bypass_until=15_000,
    learning_rate=2e-4,
    warm_up=2_000,
    photograph_share=(1.0, 1.0),
    disparity_weight=(0.0, 0.0),
)

CONFIGURATIONS: Mapping[str, Configuration] = MappingProxyType(
    {
        "compact": Configuration(
            shapes=BatchShapes(
                num_scenes=2,
                view_shares=((2, 0.66), (3, 0.08), (4, 0.15), (6, 0.04), (8, 0.07)),
                num_target=2,
                sizes=((128, 128), (96, 160), (160, 96), (96, 128), (160, 160), (128, 192)),
            ),
            schedule=Schedule(num_steps=9_000, one_stage_until=1_000, bypass_until=1_400),
            distortion=LogDistortion(),
        ),
        "paper-re10k": Configuration(
            shapes=BatchShapes(num_scenes=1, view_shares=((2, 1.0),), num_target=4, sizes=((256, 256),)),
            schedule=_PAPER_SCHEDULE,
            precision="bfloat16",
            sender=PaperSenderConfig(),
        ),
        "paper-dl3dv": Configuration(
            shapes=BatchShapes(num_scenes=1, view_shares=((8, 1.0),), num_target=4, sizes=((256, 448),)),
            schedule=_PAPER_SCHEDULE,
            lambda_range=(LAMBDA_MIN, 1e-3),
            precision="bfloat16",
            sender=PaperSenderConfig(matching_scale=2),
        ),
    }
)


def configuration_named(name: str) -> Configuration:
    """Return the configuration of this name. Raises InputError if there is none."""
    if name not in CONFIGURATIONS:
        raise InputError(f"There is no training configuration '{name}'; choose one of {', '.join(CONFIGURATIONS)}.")
    return CONFIGURATIONS[name]
