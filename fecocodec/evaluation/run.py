"""Measure every entry with every system in several metrics, record the results, and optionally draw strips."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.captures.evaluation_index import IndexEntry
from fecocodec.errors import FecoError
from fecocodec.evaluation.extras import require_extra, require_packages
from fecocodec.evaluation.machine import forget_peak, peak_mib
from fecocodec.evaluation.novel_views import EntryReader, open_scenes, without_guides
from fecocodec.evaluation.records import Key, Measurement, RecordFile
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.views import Views
from fecocodec.rendering.lpips import TRUNKS, is_lpips_there, lpips_alex, lpips_vgg
from fecocodec.rendering.metrics import MS_SSIM_LEAST_SIDE, ms_ssim, psnr, ssim
from fecocodec.rendering.perceptual import ST_LPIPS_LEAST_SIDE, st_lpips
from fecocodec.sender.input_warnings import check_input


@torch.no_grad()
def measure_quality(
    images: Float[Tensor, "image 3 height width"],
    targets: Float[Tensor, "image 3 height width"],
    ignored: Bool[Tensor, "image height width"] | None = None,
) -> dict[str, Any]:
    """Return the fields of a `Measurement` that are means over images. images, targets: sRGB in [0, 1].

    psnr in dB; ssim and ms_ssim are 1, the others 0 for identical images. ms_ssim, and the LPIPS kinds: None if a side
    is too short, or if the weights are not installed. ignored: pixels that do not count in PSNR, and are equal in both;
    None if all count. Raises InputError if a package of the `eval` extra is missing.
    """
    return dict(
        psnr=float(psnr(images, targets, ignored).mean()),
        ssim=float(ssim(images, targets).mean()),
        ms_ssim=float(ms_ssim(images, targets).mean()) if min(images.shape[-2:]) >= MS_SSIM_LEAST_SIDE else None,
        flip=_flip(images, targets),
        st_lpips=float(st_lpips(images, targets).mean()) if min(images.shape[-2:]) >= ST_LPIPS_LEAST_SIDE else None,
        lpips=float(lpips_vgg(images, targets).mean()) if _has_lpips("vgg16", images) else None,
        lpips_alex=float(lpips_alex(images, targets).mean()) if _has_lpips("alexnet", images) else None,
    )


def _has_lpips(trunk: str, images: Tensor) -> bool:
    return min(images.shape[-2:]) >= TRUNKS[trunk].least_side and is_lpips_there(trunk)


def _flip(images: Tensor, targets: Tensor) -> float:
    """Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020, at 67 pixels per degree."""
    library = require_extra("flip_evaluator", "FLIP")
    pairs = zip(*(rearrange(stack, "i rgb h w -> i h w rgb").numpy() for stack in (targets, images)), strict=True)
    errors = [library.evaluate(target, image, "LDR", applyMagma=False)[1] for target, image in pairs]
    return float(sum(errors) / len(errors))


Draw = Callable[[IndexEntry, System, Views, Reconstruction], None]


def draw_nothing(entry: IndexEntry, system: System, views: Views, reconstruction: Reconstruction) -> None:
    """Draw no strips."""


def measure_all(
    read: EntryReader,
    entries: Sequence[IndexEntry],
    systems: Sequence[System],
    records: RecordFile,
    model: str,
    draw: Draw = draw_nothing,
    device: str = "cpu",
) -> Iterator[Measurement]:
    """Run the measurements that `records` does not contain yet for these inputs, and yield all measurements.

    read: reads the views of an entry. model: label of the weights, part of the key of a measurement. draw: called after
    each new measurement. device: whose peak memory is measured. A failure is yielded with its error, and does not
    affect other measurements. Systems that learn from guides are measured on entries with guides only.
    """
    for entry in entries:
        measured = [system for system in systems if entry.guide or system.learn is None]
        try:
            inputs = read.digest(entry)
        except FecoError as error:
            yield from (_failure((entry.name, s.name, s.setting, model, ""), entry, error) for s in measured)
            continue
        keys = {(entry.name, system.name, system.setting, model, inputs): system for system in measured}
        missing = {key: system for key, system in keys.items() if not records.is_known(key)}
        yield from (records.measurements[key] for key in keys if key not in missing)
        if not missing:
            continue
        try:
            views = read(entry)
            doubts = check_input(views.select(list(range(len(entry.context)))))
        except FecoError as error:
            yield from (_recorded(records, _failure(key, entry, error)) for key in missing)
            continue
        for key, system in missing.items():
            try:
                measurement = measure(key, entry, system, views, draw, device)
            except (FecoError, RuntimeError, ArithmeticError, ValueError) as error:  # must not stop the evaluation
                measurement = _failure(key, entry, error)
            warnings = " ".join(dict.fromkeys((*doubts, measurement.warnings))).strip()
            yield _recorded(records, replace(measurement, warnings=warnings))


def evaluate(system: System, root: Path, entries: Sequence[IndexEntry], size: tuple[int, int]) -> Iterator[Measurement]:
    """Yield the measurement of each entry. root: folder of scenes. size: (height, width) in pixels.

    Raises InputError, before the first entry, if a package of the `eval` extra is missing, and FecoError for an entry
    that cannot be measured.
    """
    require_packages(())
    read = open_scenes(root, size)
    for entry in entries:
        yield measure((entry.name, system.name, system.setting, "", ""), entry, system, read(entry))


def measure(
    key: Key, entry: IndexEntry, system: System, read: Views, draw: Draw = draw_nothing, device: str = "cpu"
) -> Measurement:
    """Encode the context views of an entry, and measure all but the guides. read: all views, as `EntryReader` gives."""
    views, guides = without_guides(read, entry)
    num_context = len(entry.context)
    forget_peak(device)
    result = system.run(views, num_context, guides)
    peak = peak_mib(device)
    shown = views.select(list(range(num_context, len(views.images))))
    target = measure_quality(shown.outside_masks(result.images[num_context:]), shown.images, shown.ignored)
    context = views.select(list(range(num_context)))
    of_context = psnr(result.images[:num_context], context.images, context.ignored)
    draw(entry, system, views, result)
    height, width = views.image_size
    return Measurement(
        *key,
        num_context=num_context,
        num_guides=result.num_guides,
        warnings=" ".join(result.warnings),
        height=height,
        width=width,
        num_bytes=result.num_bytes,
        bits_per_pixel=8 * result.num_bytes / (num_context * height * width),
        num_gaussians=result.gaussians.count if result.gaussians else 0,
        **target,
        context_psnr=float(of_context.clamp_max(99.0).mean()),
        encode_seconds=result.encode_seconds,
        decode_seconds=result.decode_seconds,
        peak_mib=peak,
    )


def _failure(key: Key, entry: IndexEntry, error: Exception) -> Measurement:
    return Measurement(*key, num_context=len(entry.context), error=f"{error}" or repr(error))


def _recorded(records: RecordFile, measurement: Measurement) -> Measurement:
    records.add(measurement)
    return measurement
