"""`fecosplat train entropy | steps | detail`: train one part of a finished model alone, and write a new model."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fecocodec.model_files import GRAPHS_FOLDER, RECEIVER_FILE, read_bytes

from .options import FILE_PATH, device_option, threads_option, with_options
from .output import say
from .paths import require_model, require_new_model
from .progress import progress_bar
from .train_options import check_inputs, configuration_options, data_options, overridden, seed_option

if TYPE_CHECKING:
    from fecocodec.sender.codec import Codec
    from fecocodec.training.configurations import Configuration
    from fecocodec.training.sources import Sources

_SCENE_FIELDS = ("view_shares", "sizes", "lambda_range")
_model_arguments = with_options(
    click.argument("model", metavar="MODEL", type=FILE_PATH), click.argument("out", metavar="OUT", type=FILE_PATH)
)
_photograph_share_option = click.option(  # equal shares at the first and the last step
    "--photograph-share", type=float, callback=lambda _ctx, _param, value: None if value is None else (value,) * 2,
    help="Fraction of photographs.  [default: 0.6]",
)  # fmt: skip


@click.command(
    short_help="Train the entropy model alone, which reduces the rate.",
    epilog="""\b
Examples:
  fecosplat train entropy weights/mine weights/next --photographs scenes/
  fecosplat train entropy weights/mine weights/next --photographs scenes/ --steps 3000 --scenes 100
  torchrun --nproc-per-node 2 -m fecosplat_cli train entropy weights/mine weights/next --photographs scenes/""",
)
@_model_arguments
@data_options
@click.option(
    "--scenes", "num_scenes", type=click.IntRange(min=1), default=400,
    help="Number of scenes per process, whose latents are kept in memory.",
)  # fmt: skip
@configuration_options("num_steps", "learning_rate", *_SCENE_FIELDS)
@_photograph_share_option
@seed_option
@device_option
@threads_option
def entropy(
    model: Path,
    out: Path,
    photographs: Path | None,
    textures: Path | None,
    num_scenes: int,
    seed: int,
    device: str,
    **overrides: Any,
) -> None:
    """Train the prior and h_a of the model in folder MODEL on latents of its other networks, which do not change.

    OUT receives the new model. The training cannot be resumed; by default it takes 12,000 steps of a tenth of a second.
    """
    _check(model, out, (photographs, textures), overrides)

    from fecocodec.receiver.model import serialise_receiver
    from fecocodec.training.train_entropy import ENTROPY, train_entropy_model

    configuration = overridden(ENTROPY, overrides)
    with _opened(model, photographs, textures, configuration, device) as (codec, sources):
        _say_rows(train_entropy_model(codec, sources, configuration, seed, num_scenes))
        _write(out, codec, serialise_receiver(codec.receiver))


@click.command(
    short_help="Train the network that proposes steps of latent optimisation alone.",
    epilog="""\b
Examples:
  fecosplat train steps weights/mine weights/next --photographs scenes/
  fecosplat train steps weights/mine weights/next --photographs scenes/ --steps 100 --views 2 --size 160x160
  fecosplat train steps weights/mine weights/next --photographs scenes/ --perceptual-weight 0.08 --sharp between""",
)
@_model_arguments
@data_options
@configuration_options("num_steps", "learning_rate", "num_target", *_SCENE_FIELDS, "perceptual_weight")
@_photograph_share_option
@click.option(
    "--sharp", type=click.Choice(["beside", "between"]),
    help="Add the trained network as that of `encode --sharpness 1`. beside: --sharpness 0 keeps the network of MODEL. "
    "between: it gets the mean of both, and -1 that of MODEL.",
)  # fmt: skip
@seed_option
@device_option
@threads_option
def steps(
    model: Path,
    out: Path,
    photographs: Path | None,
    textures: Path | None,
    sharp: str | None,
    seed: int,
    device: str,
    **overrides: Any,
) -> None:
    """Train the step network of the model in folder MODEL, while scenes are encoded as in use.

    OUT receives the new model, with the same receiver. The training cannot be resumed; by default it takes 350 steps of
    some seconds.
    """
    _check(model, out, (photographs, textures), overrides)

    from fecocodec.training.train_steps import STEPS, train_step_network, with_sharp_steps

    configuration = overridden(STEPS, overrides)
    with _opened(model, photographs, textures, configuration, device) as (codec, sources):
        before = deepcopy(codec) if sharp else codec
        _say_rows(train_step_network(codec, sources, configuration, seed))
        if sharp is not None:
            codec = with_sharp_steps(before, [codec.sender.get_submodule("steps").state_dict()], sharp == "between")
        _write(out, codec, read_bytes(model / RECEIVER_FILE), model / GRAPHS_FOLDER)


@click.command(
    short_help="Fit the basis and the tables of the detail layer.",
    epilog="""\b
Examples:
  fecosplat train detail weights/mine weights/next --photographs scenes/ --index pairs.json
  fecosplat train detail weights/mine weights/next --photographs scenes/ --index pairs.json --pairs 16
  fecosplat train detail weights/mine weights/next --photographs scenes/ --index pairs.json --components 32""",
)
@_model_arguments
@click.option("--photographs", type=FILE_PATH, required=True, help="Folder with one folder per training scene.")
@click.option(
    "--index", type=FILE_PATH, required=True, metavar="FILE.json",
    help="Evaluation index of these scenes, as of `eval`: entries of two context views are used, targets are not.",
)  # fmt: skip
@click.option(
    "--components", "num_components", type=click.IntRange(1, 224), default=64,
    help="Coefficients of a block of 8x8 pixels.",
)  # fmt: skip
@click.option(
    "--pairs", "num_pairs", type=click.IntRange(min=1), default=40,
    help="Number of pairs, drawn from the index.",
)  # fmt: skip
@device_option
@threads_option
def detail(
    model: Path, out: Path, photographs: Path, index: Path, num_components: int, num_pairs: int, device: str
) -> None:
    """Fit a new detail layer to training scenes, for the networks of the model in folder MODEL, which do not change.

    OUT receives the new model. Forty pairs take a quarter of an hour of one core.
    """
    _check(model, out, (photographs, index), {})

    from fecocodec.receiver.model import serialise_receiver
    from fecocodec.rendering.cuda import require_rendering_device
    from fecocodec.sender.codec import load_codec
    from fecocodec.training.train_detail import coded_scenes, fit_detail

    require_rendering_device(device)
    codec = load_codec(model, device)
    coded = list(coded_scenes(codec, photographs, index, num_pairs))
    _write(out, codec, serialise_receiver(fit_detail(codec, coded, num_components)))


def _check(model: Path, out: Path, inputs: tuple[Path | None, ...], overrides: dict[str, Any]) -> None:
    """Refuse what cannot be read or written, or is out of range, before torch is loaded."""
    require_model(model)
    require_new_model(out)
    check_inputs(inputs, overrides)


@contextmanager
def _opened(
    model: Path, photographs: Path | None, textures: Path | None, configuration: "Configuration", device: str
) -> Iterator[tuple["Codec", "Sources"]]:
    """Join the other processes, if there are any, and open the networks of a model and the data."""
    from fecocodec.rendering.cuda import require_rendering_device
    from fecocodec.sender.codec import load_codec
    from fecocodec.training.processes import joined_processes
    from fecocodec.training.sources import open_sources

    require_rendering_device(device)
    with joined_processes(device) as own_device:
        codec = deepcopy(load_codec(model, own_device))  # it is trained in place; the loaded one is cached
        yield codec, open_sources(photographs, textures, configuration)


def _say_rows(rows: Iterator[dict[str, float]]) -> None:
    from fecocodec.training.processes import is_first

    for row in rows:
        if is_first():
            say("  ".join(f"{name} {value:.4g}" for name, value in row.items()))


def export_graphs(model: Path) -> None:
    """Export the graphs of a model that was written, with progress: they take longer than anything else at its end."""
    from fecocodec.training.graphs.export import export_receiver

    say(f"{model}: the weights are written; exporting their graphs takes about three minutes")
    with progress_bar() as on_progress:
        export_receiver(model, on_progress)


def _write(out: Path, codec: "Codec", receiver: bytes, graphs: Path | None = None) -> None:
    """Write a model. receiver: bytes of its file. graphs: folder of its graphs, None to export them."""
    from fecocodec.model_files import model_id_of
    from fecocodec.training.model_weights import write_model
    from fecocodec.training.processes import is_first

    if not is_first():
        return
    write_model(out, receiver, codec.sender)
    if graphs is None:
        export_graphs(out)
    elif graphs.exists():
        shutil.copytree(graphs, out / GRAPHS_FOLDER, dirs_exist_ok=True)
    say(f"{out}: model id {model_id_of(receiver).hex()}")
