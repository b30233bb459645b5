"""Groups of systems by name, as `fecosplat eval --systems` asks for them."""

from collections.abc import Sequence

from fecocodec.errors import InputError
from fecocodec.evaluation.ablations import ablation_systems
from fecocodec.evaluation.codec_systems import codec_system
from fecocodec.evaluation.floor import floor_systems
from fecocodec.evaluation.gaussian_systems import gaussian_systems
from fecocodec.evaluation.image_systems import image_systems
from fecocodec.evaluation.reconstruction import System
from fecocodec.sender.encode import Profile

GROUPS = ("codec", "ablations", "images", "gaussians", "floor")
LAMBDAS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5)


def systems_of(groups: Sequence[str], profile: Profile, lambdas: Sequence[float]) -> tuple[System, ...]:
    """The systems of these groups, in the order of GROUPS; lambdas matter to the first two.

    Raises InputError for a group that does not exist and for a lambda outside the codec's range.
    """
    if unknown := [group for group in groups if group not in GROUPS]:
        raise InputError(f"there are no systems called {', '.join(unknown)}; choose from {', '.join(GROUPS)}.")
    makers = {
        "codec": lambda: tuple(codec_system(profile, lmbda) for lmbda in lambdas),
        "ablations": lambda: tuple(system for lmbda in lambdas for system in ablation_systems(profile, lmbda)),
        "images": lambda: image_systems(profile),
        "gaussians": lambda: gaussian_systems(profile),
        "floor": floor_systems,
    }
    return tuple(system for group in GROUPS if group in groups for system in makers[group]())
