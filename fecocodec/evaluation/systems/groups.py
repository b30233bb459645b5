"""Groups of systems by name, for `fecosplat eval --systems`."""

from collections.abc import Callable, Sequence
from functools import partial

from fecocodec.container import quantise_lambda
from fecocodec.errors import InputError
from fecocodec.evaluation.systems.codec import ABLATIONS, ablation_system, codec_system, estimated_system, guided_system
from fecocodec.evaluation.systems.gaussian_compression import spz_systems
from fecocodec.evaluation.systems.gaussian_maps import gaussian_map_systems
from fecocodec.evaluation.systems.image_compression import image_systems
from fecocodec.evaluation.systems.reconstruction import System
from fecocodec.evaluation.systems.trivial_baselines import trivial_baselines
from fecocodec.limits import MAX_STAGES
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import check_lambda

OF_LAMBDA: dict[str, Callable[[Codec, float], System]] = {
    "codec": codec_system,
    "fast": partial(codec_system, effort="fast"),
    "best": partial(codec_system, effort="best"),
    "guided": guided_system,
    **{part: partial(ablation_system, part) for part in ABLATIONS},
}
WHATEVER_LAMBDA: dict[str, Callable[[Codec], tuple[System, ...]]] = {
    "images": image_systems,
    "gaussians": lambda codec: (*gaussian_map_systems(codec), *spz_systems(codec)),
    "trivial": lambda _profile: trivial_baselines(),
}
ALIASES = {"ablations": ABLATIONS}
GROUPS = (*OF_LAMBDA, *WHATEVER_LAMBDA)
LAMBDAS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5)


def systems_of(groups: Sequence[str], codec: Codec, lambdas: Sequence[float]) -> tuple[System, ...]:
    """Return the systems of these groups, in the order of GROUPS; those of OF_LAMBDA once per lambda.

    "codec" also measures a model of three stages with all of them, whose rate is an estimate. Raises InputError for an
    unknown group, and for a lambda outside the range of the codec.
    """
    named = [name for group in groups for name in ALIASES.get(group, (group,))]
    if unknown := [name for name in named if name not in GROUPS]:
        choice = ", ".join((*GROUPS, *ALIASES))
        raise InputError(f"there are no systems called {', '.join(unknown)}; choose from {choice}.")
    systems: list[System] = []
    for group in GROUPS:
        if group in named and group in OF_LAMBDA:
            systems += map(partial(OF_LAMBDA[group], codec), lambdas)
            if group == "codec" and codec.receiver.config.num_stages > MAX_STAGES:
                systems += map(partial(estimated_system, codec), lambdas)
        elif group in named:
            systems += WHATEVER_LAMBDA[group](codec)
    return tuple(systems)


def lambdas_in_range(codec: Codec, lambdas: Sequence[float] | None) -> tuple[float, ...]:
    """Return these lambdas, or (None) those of LAMBDAS for which the model was trained.

    Raises InputError for a lambda outside the range of the model.
    """
    lowest, highest = codec.receiver.config.lambda_range
    if lambdas is None:
        return tuple(lmbda for lmbda in LAMBDAS if lowest <= lmbda <= highest)
    for lmbda in lambdas:
        check_lambda(codec.receiver.config, quantise_lambda(lmbda))
    return tuple(lambdas)
