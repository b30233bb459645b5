"""Measure pose estimation on scenes with known cameras, which are hidden from the estimator.

    python benchmarks/pose_estimation.py DATA INDEX.json [--psnr NUMBER] [--size PIXELS] [--match LABEL] > table.tsv

For each entry of the evaluation index, cameras of the context photographs are estimated. Reported are the number of
registered photographs, the median errors of rotations and directions between pairs of cameras in degrees, the mean
error of the camera centres after alignment by a similarity (relative to their spread), the ratio of the focal
lengths, the reprojection error, the differences of the second estimate in degrees (nan for two photographs, and if it
lacks a camera), and whether a warning is printed. With --psnr, the first NUMBER entries are also encoded with stored
and with estimated cameras. The last column is then, in dB, the PSNR of the target views with stored cameras, and what
estimated cameras lose: at the target views with the estimated lens, at the target views with the stored lens, and at
the context views. Poses of target views are carried over by the similarity. All photographs have the same lens, so a
user of estimated cameras renders with the estimated lens; with the stored one, an error of the focal length is a zoom
of the rendering.
"""

import shutil
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import torch

from fecocodec import decode, encode, read_views
from fecocodec.camera_files.find import read_cameras
from fecocodec.camera_files.posed_photographs import PosedPhotograph
from fecocodec.captures.evaluation_index import IndexEntry, read_index
from fecocodec.errors import FecoError
from fecocodec.evaluation.novel_views import render_views
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.poses.posed_folder import PosedFolder, posed_folder
from fecocodec.rendering.metrics import psnr

COLUMNS = (
    "entry", "views", "registered", "rotation_deg", "direction_deg", "centre", "focal", "px", "second_rotation_deg",
    "second_direction_deg", "warned", "seconds", "psnr",
)  # fmt: skip


@click.command()
@click.argument("data", type=click.Path(path_type=Path))
@click.argument("index", type=click.Path(path_type=Path))
@click.option("--psnr", "num_encoded", type=int, default=0, help="Number of entries to encode with both cameras.")
@click.option("--size", "side", type=int, default=256, help="Side of the coded views in pixels, with --psnr.")
@click.option("--match", "label", default="", help="Only entries whose name contains this text.")
def main(data: Path, index: Path, num_encoded: int, side: int, label: str) -> None:
    """Print one row per entry as TSV, then a summary by number of views."""
    print("\t".join(COLUMNS))
    rows = []
    for number, entry in enumerate(entry for entry in read_index(index) if label in entry.name):
        row = measure(data, entry, side if number < num_encoded else None)
        rows.append(row)
        print("\t".join(row), flush=True)
    for count in sorted({int(row[1]) for row in rows}):
        of_count = [row for row in rows if int(row[1]) == count]
        full = sum(row[2] == row[1] for row in of_count)
        print(f"# {count} views: {full} of {len(of_count)} entries registered fully", flush=True)


def measure(data: Path, entry: IndexEntry, side: int | None) -> tuple[str, ...]:
    """Return the row of an entry. side: of the views that are encoded with both cameras; None encodes nothing."""
    scene = read_cameras(data / entry.scene)
    context = [scene.photographs[view] for view in entry.context]
    start = time.perf_counter()
    with TemporaryDirectory() as temporary:
        for photograph in context:
            shutil.copy(photograph.path, temporary)
        try:
            with posed_folder(Path(temporary), num_threads=1) as posed:
                seconds = time.perf_counter() - start
                errors = compare(context, posed)
                loss = psnr_lost(data, entry, context, posed, side) if side is not None else ""
        except FecoError as error:
            return (
                entry.name,
                str(len(context)),
                "0",
                *[""] * 8,
                f"{time.perf_counter() - start:.1f}",
                str(error)[-60:],
            )
    return (entry.name, str(len(context)), *errors, f"{seconds:.1f}", loss)


def compare(context: list[PosedPhotograph], posed: PosedFolder) -> tuple[str, ...]:
    """Return the columns from `registered` to `warned`."""
    cameras = posed.reconstruction.cameras
    truth = stored_poses(context, posed)
    found = np.stack([camera.camera_to_world for camera in cameras])
    rotation, direction = [], []
    for i in range(len(found)):
        for j in range(i):
            known, estimated = (np.linalg.inv(poses[i]) @ poses[j] for poses in (truth, found))
            rotation.append(angle_of(known[:3, :3].T @ estimated[:3, :3]))
            direction.append(angle_between(known[:3, 3], estimated[:3, 3]))
    scale, turn, shift = similarity(found[:, :3, 3], truth[:, :3, 3], found, truth)
    centres = scale * found[:, :3, 3] @ turn.T + shift
    spread = np.linalg.norm(truth[:, :3, 3] - truth[:, :3, 3].mean(axis=0), axis=1).max()
    error = np.linalg.norm(centres - truth[:, :3, 3], axis=1).mean() / spread
    lens = cameras[0].lens
    known_lens = context[0].lens_for(lens.width, lens.height)
    return (
        str(len(cameras)),
        f"{np.median(rotation):.2f}",
        f"{np.median(direction):.2f}",
        f"{error:.3f}",
        f"{lens.fx / known_lens.fx:.3f}",
        f"{posed.reconstruction.reprojection_error_px:.2f}",
        *(f"{degrees:.1f}" for degrees in posed.reconstruction.difference or (float("nan"), float("nan"))),
        "yes" if posed.warnings else "no",
    )


def stored_poses(context: list[PosedPhotograph], posed: PosedFolder) -> np.ndarray:
    by_name = {photograph.path.name: photograph.camera_to_world for photograph in context}
    return np.stack([by_name[camera.name] for camera in posed.reconstruction.cameras])


def similarity(
    source: np.ndarray, target: np.ndarray, source_poses: np.ndarray, target_poses: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return scale, rotation and shift from source to target: mean of relative rotations, then scale and shift."""
    total = sum(known[:3, :3] @ found[:3, :3].T for known, found in zip(target_poses, source_poses, strict=True))
    left, _, right = np.linalg.svd(total)
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    centred, wanted = (source - source.mean(axis=0)) @ turn.T, target - target.mean(axis=0)
    scale = float((centred * wanted).sum() / (centred**2).sum())
    return scale, turn, target.mean(axis=0) - scale * turn @ source.mean(axis=0)


def psnr_lost(data: Path, entry: IndexEntry, context: list[PosedPhotograph], posed: PosedFolder, side: int) -> str:
    """Return the PSNR of the targets with stored cameras, then three losses with estimated cameras, in dB.

    The losses are those of the targets with the estimated lens, of the targets with the stored lens, and of the context
    views. side: of the coded views in pixels.
    """
    num_context = len(context)
    both = read_views(data / entry.scene, views=(*entry.context, *entry.target), size=(side, side))
    stored = both.select(list(range(num_context)))
    targets = both.select(list(range(num_context, num_context + len(entry.target))))
    estimated = replace(read_views(posed.path, size=(side, side)), alpha=None)
    if estimated.cameras.num_views != num_context:
        return "not all registered"
    carried = carry_over(targets, stored, estimated, stored_poses(context, posed))
    same_lens = replace(
        targets, cameras=replace(carried.cameras, intrinsics=carried.cameras.intrinsics * lens_ratio(stored, estimated))
    )
    known, found = (Gaussians.of(decode(encode(scene, effort="fast")).gaussians) for scene in (stored, estimated))
    wanted = score(known, targets)
    losses = (
        wanted - score(found, same_lens),
        wanted - score(found, carried),
        score(known, stored) - score(found, estimated),
    )
    return " ".join([f"{wanted:.2f}", *(f"{loss:+.2f}" for loss in losses)])


def carry_over(targets: Views, stored: Views, estimated: Views, truth: np.ndarray) -> Views:
    """Return the targets with poses in the frame of the estimated cameras (similarity between context cameras)."""
    found = estimated.cameras.extrinsics.numpy().astype(np.float64)
    scale, turn, shift = similarity(found[:, :3, 3], truth[:, :3, 3], found, truth)
    poses = targets.cameras.extrinsics.numpy().astype(np.float64)
    poses[:, :3, :3] = turn.T @ poses[:, :3, :3]
    poses[:, :3, 3] = (poses[:, :3, 3] - shift) @ turn / scale
    bounds = {"near": estimated.cameras.near, "far": estimated.cameras.far}
    extrinsics = torch.from_numpy(poses.astype(np.float32))
    return replace(targets, cameras=replace(targets.cameras, extrinsics=extrinsics, **bounds))


def lens_ratio(stored: Views, estimated: Views) -> torch.Tensor:
    """Return the 3x3 factors that turn the stored lens into the estimated one; the principal point stays."""
    ratio = (estimated.cameras.intrinsics / stored.cameras.intrinsics)[:, [0, 1], [0, 1]].mean(dim=0)
    return torch.ones(3, 3).index_put((torch.tensor([0, 1]), torch.tensor([0, 1])), ratio)


def score(gaussians: Gaussians, views: Views) -> float:
    return float(psnr(render_views(gaussians, views), views.images).mean())


def angle_of(rotation: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def angle_between(first: np.ndarray, second: np.ndarray) -> float:
    cosine = first @ second / (np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


if __name__ == "__main__":
    main()
