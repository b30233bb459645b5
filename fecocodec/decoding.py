"""Decode a `.fcs` stream: the function that commands, batches and programs call. Torch is loaded only where needed."""

from importlib.util import find_spec
from pathlib import Path

from fecocodec.container import Stages, check_pixels, read_stages
from fecocodec.errors import InputError
from fecocodec.geometry.gaussian_arrays import GaussianArrays
from fecocodec.limits import DEFAULT_MAX_PIXELS, MAX_SH_DEGREE
from fecocodec.merging.grouping import DEFAULT_MERGING
from fecocodec.model_files import find_receiver, has_graphs
from fecocodec.progress import OnProgress, ignore_progress
from fecocodec.runtime.scene import Decoded as Decoded


def decode(
    data: bytes,
    *,
    stages: Stages = "all",
    sh_degree: int = MAX_SH_DEGREE,
    has_background: bool = True,
    is_merged: bool = True,
    device: str = "cpu",
    num_threads: int = 0,
    model: Path | str | None = None,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    on_progress: OnProgress = ignore_progress,
) -> Decoded:
    """Decode a `.fcs` stream to Gaussians and cameras, which are NumPy arrays.

    stages: "all" decodes the whole stream and rejects a damaged one. 1 or 2 decodes that many stages; the rest of the
    stream may be damaged or missing. "intact" decodes the stages before the first damage, which `Decoded.damage` then
    describes.
    sh_degree: largest degree of the spherical harmonics, of which a model emits 1 or 2; 0 for constant colours.
    has_background: whether to add the layer that fills what no context view shows.
    is_merged: whether to merge neighbouring Gaussians of similar colour; without it they stay on their grid.
    device: "cpu", "cuda" or "cuda:N". On "cpu", onnxruntime computes. Torch computes on other devices and, where it is
    installed, for models without all graphs (`model_files.has_graphs`). Both agree within FORMAT.md, section 15.
    num_threads: of onnxruntime; 0 for all cores. model: folder of the model; None for the shipped model with the model
    id of the stream. max_pixels: limit on the pixels of all views, to which time and memory are proportional.
    on_progress: called with the current task and the fraction done in [0, 1].

    Raises BitstreamError for a stream that breaks a rule of the format; InputError if the stream has fewer stages or
    more pixels, sh_degree is not supported, or the device is missing; ModelError if the weights of the model are not
    found, or its graphs are missing and torch is not installed.
    """
    part = read_stages(data, stages)
    header = part.stream.header
    check_pixels(header, max_pixels)
    if sh_degree not in range(MAX_SH_DEGREE + 1):
        raise InputError(f"spherical harmonics of degree {sh_degree} are not supported; choose 0 to {MAX_SH_DEGREE}.")
    folder = find_receiver(header.model_id, None if model is None else Path(model)).parent
    merging = DEFAULT_MERGING if is_merged else None
    if device == "cpu" and (has_graphs(folder, header.model_id) or find_spec("torch") is None):
        from fecocodec.runtime.decode import decode as decode_with_graphs
        from fecocodec.runtime.emission import EmissionConfig
        from fecocodec.runtime.graphs import graphs_of

        graphs = graphs_of(folder.absolute(), header.model_id, num_threads)
        return decode_with_graphs(graphs, part, stages, EmissionConfig(sh_degree, has_background, merging), on_progress)

    from fecocodec.layers.memory_format import usable_device
    from fecocodec.receiver.decode import decode as decode_with_torch
    from fecocodec.splatting.background import DEFAULT_BACKGROUND

    usable_device(device)
    decoded = decode_with_torch(
        data,
        stages=stages,
        sh_degree=sh_degree,
        background=DEFAULT_BACKGROUND if has_background else None,
        merging=merging,
        device=device,
        model=folder,
        max_pixels=max_pixels,
        on_progress=on_progress,
    )
    return Decoded(
        GaussianArrays(*(field.numpy() for field in decoded.gaussians.fields())),
        decoded.cameras.arrays(),
        decoded.image_size,
        decoded.stages,
        decoded.damage,
    )
