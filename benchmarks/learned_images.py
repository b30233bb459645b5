"""A plain learned image codec: photographs coded by our own g_a, entropy model and g_s, trained for it.

python benchmarks/learned_images.py PHOTOGRAPHS SCENES INDEX.json WORK [--minutes 60] [--entries 12]

One stage codes each photograph alone: pixels of 4x4 cells -> g_a -> latents -> g_s and U -> pixels. The networks start
from the shipped ones and are trained on random crops of all photographs of PHOTOGRAPHS, with our D of a photograph plus
lambda R. Before coding, latents take steps along the gradient of D + lambda R, as our latents do. The receiver runs our
networks on the decoded photographs, as it does for AVIF (`fecocodec/evaluation/systems/image_compression.py`). SCENES
and INDEX.json are those of `fecosplat eval`; its pairs of 256x256 are measured, with the codec beside it.

WORK receives the weights and the measurements. The same command measures again without training.
"""

import argparse
import random
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import monotonic, perf_counter

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image, ImageOps
from torch import Tensor, nn

from fecocodec.captures.evaluation_index import read_index
from fecocodec.checkpoint import DEFAULT_MODEL, SHIPPED
from fecocodec.coding.camera_packing import pack, unpack
from fecocodec.coding.payload import decode_latents, encode_latents
from fecocodec.container import LAMBDA_Q_MAX, quantise_lambda
from fecocodec.container.cameras import pack_cameras, unpack_cameras
from fecocodec.evaluation.evaluation import choose_entries, weights_label
from fecocodec.evaluation.novel_views import open_scenes
from fecocodec.evaluation.records import RecordFile
from fecocodec.evaluation.report.rate_section import equal_bytes_table
from fecocodec.evaluation.report.section import number, table
from fecocodec.evaluation.run import measure_all
from fecocodec.evaluation.summary import Average, averages
from fecocodec.evaluation.systems.codec import codec_system, rendered
from fecocodec.evaluation.systems.groups import LAMBDAS
from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.evaluation.systems.uncoded import uncoded_gaussians
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec, load_codec
from fecocodec.sender.distortion import LogDistortion
from fecocodec.sender.optimisation_config import FAST
from fecocodec.sender.stages import StageInputs
from fecocodec.training.loss import ENTROPY_PRICE, lambda_of
from fecocodec.training.training_pass import code_with_noise

NAME = "learned image codec"
CELL = 4
SIDES = (192, 384)  # short side of a photograph before it is cropped, in pixels
CROP = 128
BATCH = 6
LEARNING_RATE = 3e-4
WARM_UP = 100  # steps
AVERAGE_DECAY = 0.998
STAGE = 1


class ImageCodec(nn.Module):
    """Photographs -> latents -> photographs. network: the codec whose weights it starts with."""

    def __init__(self, network: Codec) -> None:
        super().__init__()
        self.receiver, self.sender = deepcopy(network.receiver), deepcopy(network.sender)
        channels = self.receiver.config.state_channels
        self.input = nn.Conv2d(3 * CELL**2, channels, 1, bias=False)
        self.output = nn.Conv2d(channels, 3 * CELL**2, 3, padding=1, bias=False)
        with torch.no_grad():  # the channels that carry pixels in the shipped networks
            self.input.weight.copy_(torch.eye(channels, 3 * CELL**2)[:, :, None, None])
            self.output.weight *= 0.1

    def used(self) -> nn.ModuleList:
        """Return the networks that photographs pass."""
        receiver, sender = self.receiver, self.sender
        parts = (receiver.prior, receiver.embedding, receiver.synthesis, receiver.update)
        return nn.ModuleList((*parts, sender.analysis, sender.hyper_analysis, self.input, self.output))

    def encode(self, images: Tensor, lambda_q: Tensor) -> Tensor:
        condition = self.receiver.condition(lambda_q, STAGE)
        features = self.input(F.pixel_unshuffle(2 * images - 1, CELL))
        state = self.receiver.update.start(len(images), *features.shape[-2:])
        return self.sender.analysis(features, state, condition)

    def decode(self, y_hat: Tensor, lambda_q: Tensor) -> Tensor:
        """Return photographs, sRGB, not clamped."""
        condition = self.receiver.condition(lambda_q, STAGE)
        start = self.receiver.update.start(len(y_hat), 2 * y_hat.shape[-2], 2 * y_hat.shape[-1])
        state = self.receiver.next_state(start, y_hat, condition)
        return 0.5 + 0.5 * F.pixel_shuffle(self.output(state), CELL)

    def judge(self, y: Tensor, images: Tensor, lambda_q: Tensor) -> tuple[Tensor, Tensor]:
        """Return D and R, bits a pixel, of each photograph. Gradients of R are scaled as `loss_of` expects them."""
        inputs = StageInputs(STAGE, True, lambda_q, self.receiver.condition(lambda_q, STAGE), y, None)
        estimate = code_with_noise(self.receiver, self.sender)(y, inputs)
        distortion = LogDistortion()(self.decode(estimate.y_hat, lambda_q), images)
        rate = estimate.bits / images[0, 0].numel()
        return distortion, rate


def train(codec: ImageCodec, folders: Path, minutes: float) -> None:
    """Train on random crops; the weights become their averages."""
    networks = codec.used().requires_grad_(True).train()
    parameters = list(networks.parameters())
    optimiser = torch.optim.AdamW(parameters, lr=LEARNING_RATE, betas=(0.9, 0.99), weight_decay=0.0)
    averages = [parameter.detach().clone() for parameter in parameters]
    torch.manual_seed(0)
    begin, passed, step = monotonic(), 0.0, 0
    for images in crops(folders):
        if passed >= 1.0:
            break
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * min(1.0, (step + 1) / WARM_UP) * 0.5 * (1 + np.cos(np.pi * passed))
        lambda_q = torch.randint(LAMBDA_Q_MAX + 1, (BATCH,))
        y = codec.encode(images, lambda_q)
        distortion, rate = codec.judge(y, images, lambda_q)
        loss = (distortion + ENTROPY_PRICE * rate).mean()
        optimiser.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(parameters, 1.0)
        if bool(norm.isfinite()):
            optimiser.step()
            decay = min(AVERAGE_DECAY, (step + 1) / (step + 10))
            for average, parameter in zip(averages, parameters, strict=True):
                average.lerp_(parameter.detach(), 1 - decay)
        step, passed = step + 1, (monotonic() - begin) / (60 * minutes)
        if step % 50 == 1:
            means = distortion.mean().item(), rate.mean().item()
            print("step {}: D {:.4f}, {:.3f} bits a pixel".format(step, *means), flush=True)
    with torch.no_grad():
        for parameter, average in zip(parameters, averages, strict=True):
            parameter.copy_(average)
    networks.requires_grad_(False).eval()


def crops(folders: Path) -> Iterator[Tensor]:
    """Yield batches of random crops of random photographs, sRGB in [0, 1]."""
    endings = (".jpg", ".jpeg", ".png", ".webp")
    scenes = [
        [path for path in sorted(scene.rglob("*")) if path.suffix.lower() in endings] for scene in folders.iterdir()
    ]
    generator = random.Random(0)
    while True:
        batch = []
        for _ in range(BATCH):
            with Image.open(generator.choice(generator.choice(scenes))) as image:
                side = generator.randint(*SIDES)
                image.draft("RGB", (side, side))
                scale = side / min(image.size)
                sides = [max(CROP, round(scale * length)) for length in image.size]
                photograph = image.convert("RGB").resize(sides, Image.Resampling.LANCZOS)
            left, top = (generator.randint(0, length - CROP) for length in photograph.size)
            crop = photograph.crop((left, top, left + CROP, top + CROP))
            crop = ImageOps.mirror(crop) if generator.random() < 0.5 else crop
            batch.append(torch.from_numpy(np.array(crop)).permute(2, 0, 1) / 255)
        yield torch.stack(batch)


def optimised(codec: ImageCodec, images: Tensor, lambda_q: Tensor, steps: int, length: float) -> Tensor:
    """Return latents after steps along the gradient of D + lambda R (Adam); those of the best step."""
    y = codec.encode(images, lambda_q).detach().requires_grad_(True)
    adam = torch.optim.Adam([y], lr=length)
    best, least = y.detach().clone(), torch.full((len(y),), torch.inf)
    with torch.enable_grad():
        for step in range(steps + 1):
            distortion, rate = codec.judge(y, images, lambda_q)
            cost = (distortion + lambda_of(lambda_q) * rate).detach()
            better = cost < least
            best[better], least = y.detach()[better], torch.where(better, cost, least)
            if step < steps:
                adam.zero_grad()
                (distortion + ENTROPY_PRICE * rate).sum().backward()
                adam.step()
    return best


def code(codec: ImageCodec, images: Tensor, lambda_q: int, cameras: bytes, steps: int, length: float) -> bytes:
    """Return a file: lambda, sizes, cameras and the payload of all photographs."""
    lambdas = torch.full((len(images),), lambda_q)
    y = optimised(codec, images, lambdas, steps, length)
    payload, _ = encode_latents(codec.receiver.prior, y, codec.sender.hyper_analysis(y), lambda_q, STAGE, None)
    numbers = (lambda_q, len(images), *images.shape[-2:], len(cameras))
    return b"".join((*(number.to_bytes(2) for number in numbers), cameras, payload))


@torch.no_grad()
def read(codec: ImageCodec, data: bytes) -> tuple[Tensor, bytes]:
    """Return the photographs and the camera section of a file."""
    lambda_q, count, height, width, length = (int.from_bytes(data[2 * k : 2 * k + 2]) for k in range(5))
    cameras, payload = data[10 : 10 + length], data[10 + length :]
    size = (count, height // 8, width // 8)
    latents = decode_latents(codec.receiver.prior, payload, size, lambda_q, STAGE, None)
    return codec.decode(latents.y_hat, torch.full((count,), lambda_q)).clamp(0, 1), cameras


def reconstruct(
    codec: ImageCodec, ours: Codec, lmbda: float, steps: int, length: float, views: Views, num_context: int
) -> Reconstruction:
    context = views.select(list(range(num_context)))
    begin = perf_counter()
    cameras = pack_cameras(pack(context.cameras))
    data = code(codec, context.images, quantise_lambda(lmbda), cameras, steps, length)
    encoded = perf_counter()
    images, section = read(codec, data)
    received = replace(context, images=images, cameras=unpack(unpack_cameras(section, len(images), NAME)))
    gaussians = uncoded_gaussians(ours, received, FAST)
    return rendered(gaussians, views, len(data), encoded - begin, perf_counter() - encoded)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path, help="folder of scenes to train on")
    parser.add_argument("scenes", type=Path, help="folder of other scenes, to measure")
    parser.add_argument("index", type=Path, help="evaluation index (JSON)")
    parser.add_argument("work", type=Path, help="folder for weights and measurements")
    parser.add_argument("--minutes", type=float, default=60.0, help="of training  [default: 60]")
    parser.add_argument("--entries", type=int, default=12, help="pairs to measure  [default: 12]")
    parser.add_argument("--steps", type=int, default=16, help="steps on the latents  [default: 16]")
    parser.add_argument("--length", type=float, default=0.1, help="of a step, in symbols  [default: 0.1]")
    arguments = parser.parse_args()
    folder = SHIPPED / DEFAULT_MODEL
    codec, weights = ImageCodec(load_codec(folder, "cpu")), arguments.work / "weights.pt"
    if not weights.exists():
        arguments.work.mkdir(parents=True, exist_ok=True)
        train(codec, arguments.photographs, arguments.minutes)
        torch.save(codec.state_dict(), weights)
    codec.load_state_dict(torch.load(weights, weights_only=True))
    codec.requires_grad_(False).eval()

    ours, size = load_codec(folder, "cpu"), (256, 256)
    setting = (arguments.steps, arguments.length)
    systems = [codec_system(ours, lmbda) for lmbda in LAMBDAS]
    systems += [System(NAME, f"lambda {x:g}", partial(reconstruct, codec, ours, x, *setting)) for x in LAMBDAS]
    entries = choose_entries(read_index(arguments.index), 2, arguments.entries, arguments.index)
    records = RecordFile(arguments.work / f"measured_{arguments.steps}_{arguments.length:g}.jsonl")
    read_views = open_scenes(arguments.scenes, size)
    found = tuple(measure_all(read_views, entries, systems, records, weights_label(folder, size)))
    if failed := [measurement for measurement in found if measurement.error]:
        raise SystemExit(f"{len(failed)} measurements failed: {failed[0].error}")
    rows = averages(found)
    head = ("system", "setting", "KiB", "target PSNR, dB", "SSIM", "context PSNR, dB", "encode, s", "decode, s")
    print(table(head, [(row.system, row.setting, *map(number, values_of(row))) for row in rows]))
    print(equal_bytes_table(found, [row.system for row in rows]))


def values_of(row: Average) -> tuple[float, ...]:
    return (row.kib, row.psnr, row.ssim, row.context_psnr, row.encode_seconds, row.decode_seconds)


if __name__ == "__main__":
    main()
