"""Options of `fecosplat train` and its verbs that override a training configuration."""

import re
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fecocodec.container import quantise_lambda
from fecocodec.limits import check_sizes, check_view_shares

from .options import FILE_PATH, parse_size, parsed, with_options
from .paths import require_input

if TYPE_CHECKING:
    from fecocodec.training.configurations import Configuration

_PAIR = {"type": float, "nargs": 2}


@parsed
def _parse_views(value: str) -> tuple[tuple[int, float], ...]:
    """Parse `2` or `2:0.8,4:0.2` to pairs of a number of context views and its probability."""
    if not re.fullmatch(r"\d{1,3}(:\d*\.?\d+)?(,\d{1,3}(:\d*\.?\d+)?)*", value):
        raise ValueError(f"{value!r} is neither a number of views nor COUNT:SHARE,COUNT:SHARE...")
    entries = [entry.partition(":") for entry in value.split(",")]
    return tuple((int(count), float(share or 1)) for count, _, share in entries)


# Of each field of a configuration: its option, the values that it takes, and its help.
_FIELDS: dict[str, tuple[str, dict[str, Any], str]] = {
    "num_steps": ("--steps", {"type": int}, "Number of steps of the optimiser."),
    "one_stage_until": ("--one-stage-steps", {"type": int}, "Number of first steps that train stage 1 only."),
    "bypass_until": ("--bypass-steps", {"type": int}, "Number of first steps without rate term and quantisation."),
    "num_scenes": (
        "--scenes",
        {"type": int},
        "Batch size: scenes per step and process, for the first --views and --size.",
    ),
    "view_shares": (
        "--views",
        {"callback": _parse_views},
        "Number of context views: 2, or probabilities such as 2:0.8,4:0.2.",
    ),
    "num_target": ("--targets", {"type": int}, "Number of target views per scene."),
    "sizes": (
        "--size",
        {"multiple": True, "callback": parse_size, "metavar": "WxH"},
        "Image size in pixels. Repeat the option for several sizes. Small sizes need --views 2.",
    ),
    "learning_rate": ("--learning-rate", {"type": float}, "Peak learning rate."),
    "lambda_range": ("--lambda-range", _PAIR, "Smallest and largest lambda."),
    "photograph_share": ("--photograph-share", _PAIR, "Fraction of photographs, at the first and last step."),
    "disparity_weight": ("--depth-weight", _PAIR, "Weight of the depth loss, at first and last step."),
    "perceptual_weight": (
        "--perceptual-weight",
        {"type": click.FloatRange(min=0)},
        "Weight of ST-LPIPS in the loss, for sharper pictures of lower PSNR.",
    ),
    "perceptual": (
        "--perceptual",
        {"type": click.Choice(["lpips", "st-lpips", "none"])},
        "Perceptual distance in the loss of the paper's configurations.  [default: lpips (VGG16)]",
    ),
    "optimised_share": (
        "--optimised-share",
        {"type": click.FloatRange(0.0, 1.0)},
        "Fraction of the steps that train the receiver on latents optimised as in encoding.",
    ),
    "precision": (
        "--precision",
        {"type": click.Choice(["float32", "bfloat16"])},
        "Number type of convolutions and attention.",
    ),
    "frozen": (
        "--freeze",
        {"multiple": True, "type": click.Choice(["receiver", "extractor", "matching"])},
        "Do not train this part. matching: all of the extractor except the fusion of its features. Repeatable.",
    ),
    "kept_batches": (
        "--keep",
        {"type": click.IntRange(min=0), "metavar": "BATCHES"},
        "Keep so many batches per process in memory with the results of the frozen extractor or matching.",
    ),
}
data_options = with_options(
    click.option("--photographs", type=FILE_PATH, help="Folder of posed scenes, each with a transforms.json."),
    click.option(
        "--textures",
        type=FILE_PATH,
        help="Folder of images that texture synthetic scenes, beside the built-in patterns.",
    ),
)
seed_option = click.option("--seed", type=click.IntRange(0, 2**31), default=0, help="Seed of random numbers.")


def check_inputs(paths: tuple[Path | None, ...], overrides: dict[str, Any]) -> None:
    """Raise InputError for a path that does not exist, or values that no configuration takes. Torch is not loaded."""
    for path in paths:
        if path is not None:
            require_input(path, "there is no such file or folder; check the path.")
    check_view_shares(overrides.get("view_shares") or ())
    check_sizes(overrides.get("sizes") or ())
    for lmbda in overrides.get("lambda_range") or ():
        quantise_lambda(lmbda)  # raises for a value outside the range


def configuration_options(*names: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that adds options of `overridden`: these, or all. Those that are not given are None."""
    chosen = {name: _FIELDS[name] for name in names or _FIELDS}
    return with_options(
        *(click.option(option, name, help=text, **values) for name, (option, values, text) in chosen.items())
    )


def overridden(configuration: "Configuration", overrides: dict[str, Any]) -> "Configuration":
    """Return the configuration with the given options in place of its own values."""
    given = {name: value for name, value in overrides.items() if value is not None}

    def of(part: Any) -> dict[str, Any]:
        return {field.name: given[field.name] for field in fields(part) if field.name in given}

    shapes = replace(configuration.shapes, **of(configuration.shapes))
    schedule = replace(configuration.schedule, **of(configuration.schedule))
    others = of(configuration)
    if "perceptual" in given:
        others["distortion"] = configuration.with_perceptual(given["perceptual"])
    if configuration.is_paper and "lambda_range" in given:
        others["receiver"] = replace(configuration.receiver, lambda_range=given["lambda_range"])
    return replace(configuration, shapes=shapes, schedule=schedule, **others)
