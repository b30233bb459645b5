"""Write what the Python receiver decodes from a stream, for the comparisons of the web tests.

Usage: python web/test/make_reference.py STREAM FOLDER

For each stage, FOLDER gets `stageN.json` with sizes and `stageN.PART.FIELD.f32` with little-endian float32 arrays. Parts:
`predicted` and `plain` are the predictor's Gaussians in the normalised frame, with harmonics of degree 1 and 0;
`final` are those that `decode` returns.
"""

import json
import sys
from pathlib import Path

import torch

from fecocodec import decode
from fecocodec.coding.camera_packing import unpack
from fecocodec.container import read_prefix
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.normalisation import normalise_scene
from fecocodec.receiver import decode as receiver_decode

FIELDS = ("means", "scales", "rotations", "opacities", "harmonics")


def write_part(folder: Path, stage: int, part: str, gaussians: Gaussians) -> dict[str, int]:
    for name, values in zip(FIELDS, gaussians.fields(), strict=True):
        array = values.detach().float().contiguous().numpy()
        (folder / f"stage{stage}.{part}.{name}.f32").write_bytes(array.astype("<f4").tobytes())
    return {"count": gaussians.count, "numHarmonics": gaussians.harmonics.shape[-2]}


def predictions(data: bytes, stages: int) -> tuple[Gaussians, Gaussians]:
    """Return the predictor's Gaussians in the normalised frame, with harmonics of degree 1 and 0."""
    stream = read_prefix(data, stages)
    receiver = receiver_decode.receiver_of(stream.header.model_id, None, "cpu")
    with torch.inference_mode():
        state, _, _ = receiver_decode._decode_stages(receiver, stream, stages, lambda _task, _fraction: None)
        normalised, _ = normalise_scene(unpack(stream.cameras))
        prediction = receiver.predict(state.state, normalised.as_batch(), state.condition)
        return receiver.appearance(prediction, normalised), prediction.gaussians.scene(0)


def main(stream: Path, folder: Path) -> None:
    data = stream.read_bytes()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.fcs").write_bytes(data)
    for stage in (1, 2):
        predicted, plain = predictions(data, stage)
        parts = {"predicted": predicted, "plain": plain, "final": decode(data, stages=stage).gaussians}
        sizes = {part: write_part(folder, stage, part, of) for part, of in parts.items()}
        (folder / f"stage{stage}.json").write_text(json.dumps(sizes))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
