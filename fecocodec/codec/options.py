"""Options of `encode_folder`. Needs no torch."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from fecocodec.captures.view_selection import All, Auto, Guides, Selection, Spread
from fecocodec.container import quantise_lambda
from fecocodec.container.metadata import pack_metadata
from fecocodec.errors import OptionError
from fecocodec.limits import MAX_VIEWS, require_depths, require_size
from fecocodec.sender.lambda_search import AtLeastNewPsnr, Target

CHOICES = {"background": (None, "white", "black"), "masks": ("leave-out", "cut-out", "unused")}
DEFAULT_FRAMES = 40  # of a video, from which cameras are estimated; the time grows with their square


@dataclass(frozen=True)
class EncodingOptions:
    """How a folder of photographs is encoded.

    lmbda, num_stages, effort, sharpness, device, model: as for `encode`. target: None encodes at `lmbda`.
    views: which photographs are coded: as for `read_views`, or `Spread`, `Auto` or `All`; None for all of up to four,
    else as many as cover the others. guides: which of the others teach the sender: None for up to 24 that overlap with
    the coded ones, `Spread` for up to so many of them, () for none, or names as for `views`. num_checks: how many are
    left out and only measured, so that the quality of new views is known; None for one in ten, from six photographs on.
    size, near, far, background, masks: as for `read_views`. metadata: stored in the file. num_frames: frames to take
    from a video, None for 40 or all of fewer. frames_folder: empty folder that keeps those with a camera. focal_px: as
    for `posed_folder`. is_strict: raise StrictError at the first warning. is_measured: decode the file and measure it;
    `is_strict` implies it. num_threads: that estimate cameras, -1 for all cores.
    """

    lmbda: float = 1e-3
    target: Target | None = None
    views: Selection | None = None
    guides: Guides = None
    num_checks: int | None = None
    size: tuple[int, int] | None = None
    near: float | None = None
    far: float | None = None
    background: Literal["white", "black"] | None = None
    masks: Literal["leave-out", "cut-out", "unused"] = "leave-out"
    num_stages: int = 2
    effort: str = "default"
    sharpness: float = 0.0
    metadata: dict[str, str] = field(default_factory=dict)
    num_frames: int | None = None
    frames_folder: Path | None = None
    focal_px: float | None = None
    is_strict: bool = False
    is_measured: bool = True
    device: str = "cpu"
    model: Path | str | None = None
    num_threads: int = -1

    def __post_init__(self) -> None:
        """Raise InputError or BitstreamError for values that no file has, OptionError for a conflict."""
        for name, choices in CHOICES.items():
            if (value := getattr(self, name)) not in choices:
                raise OptionError(f"`{name}` is {value!r}; give one of {', '.join(map(repr, choices))}.")
        for name in ("num_frames", "focal_px"):
            if (number := getattr(self, name)) is not None and not number > 0:
                raise OptionError(f"`{name}` is {number:g}; give a number above 0.")
        quantise_lambda(self.lmbda)
        if self.size is not None:
            require_size(self.size)
        if self.near is not None and self.far is not None:
            require_depths(self.near, self.far)
        pack_metadata(self.metadata)
        if self.target is not None and self.num_stages == 1:
            raise OptionError("`stages=1` has no rate control; leave out `stages` or the target.")
        if isinstance(self.target, AtLeastNewPsnr) and self.num_checks == 0:
            raise OptionError("a PSNR of new views is measured on `checks`, and there are none; give a number of them.")
        if self.sharpness != 0.0 and self.effort == "fast":
            raise OptionError("`sharpness` needs the steps that `effort` fast leaves out; give one of them.")
        if self.views is not None and not _is_choice(self.views, Spread, Auto, All):
            raise OptionError(f"`views` is {self.views!r}; give a tuple of names as text, `Spread`, `Auto` or `All`.")
        if isinstance(self.views, Spread) and not 1 <= self.views.count <= MAX_VIEWS:
            raise OptionError(f"{self.views.count} `views` asked for, but a file holds 1 to {MAX_VIEWS}.")
        if self.guides is not None and not _is_choice(self.guides, Spread):
            raise OptionError(f"`guides` is {self.guides!r}; give a tuple of names as text, `Spread`, or () for none.")
        if self.num_checks is not None and self.num_checks < 0:
            raise OptionError(f"{self.num_checks} `checks` asked for; give 0 or more.")
        if isinstance(self.views, All) and (self.guides or self.num_checks):
            raise OptionError("`views=all` codes every photograph; leave out `guides` and `checks`, or choose `views`.")

    def require_device(self) -> None:
        """Raise InputError if the device cannot be used. Feedback and optimisation of latents render on it."""
        from fecocodec.layers.memory_format import usable_device
        from fecocodec.rendering.cuda import require_rendering_device

        if self.num_stages == 1 and self.effort == "fast":
            usable_device(self.device)
        else:
            require_rendering_device(self.device)


def _is_choice(value: object, *kinds: type) -> bool:
    """Return whether a value is of one of the kinds, or a tuple of names and numbers of photographs."""
    return isinstance(value, kinds) or (isinstance(value, tuple) and all(isinstance(one, int | str) for one in value))
