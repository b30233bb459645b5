"""Small data sets in the layout of pixelSplat's chunks: a painted wall seen by cameras whose truth is known."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from tests.wall_scene import Shot, shots, take

VIDEO = "https://video.example/watch?v=0"


def record(key: str, taken: list[Shot], url: str = VIDEO, quality: int = 95) -> dict:
    """One scene as pixelSplat stores it; images are JPEG, cameras are world-to-camera rows after the intrinsics."""
    images = []
    for shot in taken:
        stream = BytesIO()
        Image.fromarray((take(shot) * 255).round().astype(np.uint8)).save(stream, "JPEG", quality=quality)
        images.append(torch.frombuffer(bytearray(stream.getvalue()), dtype=torch.uint8))
    return {
        "key": key,
        "url": url,
        "timestamps": torch.arange(len(taken)) * 33000,
        "cameras": torch.tensor(np.stack([camera_row(shot) for shot in taken]), dtype=torch.float32),
        "images": images,
    }


def camera_row(shot: Shot) -> np.ndarray:
    intrinsics = (shot.fx / shot.width, shot.fy / shot.height, shot.cx / shot.width, shot.cy / shot.height, 0, 0)
    return np.concatenate((intrinsics, np.linalg.inv(shot.camera_to_world)[:3].ravel()))


def write_chunks(folder: Path, chunks: list[list[dict]]) -> Path:
    """Chunk files with their index."""
    folder.mkdir(parents=True, exist_ok=True)
    index = {}
    for number, records in enumerate(chunks):
        torch.save(records, folder / f"{number:06}.torch")
        index |= {entry["key"]: f"{number:06}.torch" for entry in records}
    (folder / "index.json").write_text(json.dumps(index))
    return folder


def write_wall_chunks(folder: Path, num_scenes: int = 3, num_frames: int = 3, **lens) -> Path:
    """Scenes `wall0`, `wall1` ... two a chunk, each of the same frames."""
    wall = record("", shots(num_frames, **lens))
    records = [wall | {"key": f"wall{number}"} for number in range(num_scenes)]
    return write_chunks(folder, [records[first : first + 2] for first in range(0, num_scenes, 2)])
