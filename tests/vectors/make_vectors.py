"""Regenerate the test vectors and list the changes: `python tests/vectors/make_vectors.py` (`make vectors`).

A changed vector is a change of the format. It needs a new `BITS` line in CHANGELOG.md, without which nothing is
written. A scene is encoded only for a new released model, whose id the CHANGELOG must state. Existing scenes are kept,
because the sender computes in floating point and its bytes differ between machines.
"""

import hashlib
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from fecocodec.checkpoint import DEFAULT_MODEL, RECEIVER_FILE, SHIPPED, model_id_of  # noqa: E402
from fecocodec.container import Stream, read_stream  # noqa: E402
from tests.vectors.faulty_vectors import faulty_vectors  # noqa: E402
from tests.vectors.gaussian_samples import has_samples, model_of, scene_samples  # noqa: E402
from tests.vectors.good_vectors import Vector, good_vectors  # noqa: E402
from tests.vectors.readme import readme  # noqa: E402
from tests.vectors.released_scenes import SCENES  # noqa: E402
from tests.vectors.symbols import camera_fingerprint, decode_detail_symbols, decode_symbols, fingerprint  # noqa: E402
from tests.vectors.tiny_model import VECTORS  # noqa: E402

CHANGELOG = ROOT / "CHANGELOG.md"
EXPECTED = "expected.json"


def main() -> int:
    made = make_all(CHANGELOG.read_text())
    here = {path.relative_to(VECTORS).as_posix() for path in VECTORS.rglob("*") if path.is_file()}
    here = {name for name in here if Path(name).suffix in (".fcs", ".json", ".md", ".f32")}
    changes = changes_of(made, {name: (VECTORS / name).read_bytes() for name in here})
    for name, change in changes.items():
        print(f"{change}  {name}")
    print(f"{len(made)} files, {len(changes)} of them new, changed or removed")
    refusal = why_not(changes, CHANGELOG.read_text(), read_expected())
    if refusal is not None:
        print(f"make_vectors: {refusal}", file=sys.stderr)
        return 1
    for name in changes:
        write(name, made.get(name))
    return 0


def make_all(changelog: str) -> dict[str, bytes]:
    """Return the content of every file below vectors/ except the models, by path."""
    good, faulty = good_vectors() | released_scenes(), faulty_vectors()
    samples = {samples_name(name): samples_of(name, vector.data) for name, vector in good.items() if has_samples(name)}
    expected = {
        "bits": newest_bits(changelog),
        "good": {name: expectation(vector) for name, vector in sorted(good.items())},
        "faulty": {
            name: {"sha256": sha256(vector.data), "rule": vector.rule, "says": vector.says}
            for name, vector in sorted(faulty.items())
        },
    }
    files = {name: vector.data for name, vector in (good | faulty).items()} | samples
    files[EXPECTED] = (json.dumps(expected, indent=1, ensure_ascii=False) + "\n").encode()
    files["README.md"] = readme(expected).encode()
    return files


def released_scenes() -> dict[str, Vector]:
    """Return the scenes of released models; encodes those of the default model that there are not."""
    released = {model_id_of(path.read_bytes()) for path in SHIPPED.glob(f"*/{RECEIVER_FILE}")}
    here = {path.stem: path.read_bytes() for path in sorted(VECTORS.glob("valid/scene-*.fcs"))}
    kept = {name: data for name, data in here.items() if read_stream(data).header.model_id in released}
    missing = {f"scene-{DEFAULT_MODEL}{kind}": scene for kind, scene in SCENES.items()}
    data_of = {name: scene.stream() for name, scene in missing.items() if name not in kept} | kept
    kinds = sorted(SCENES, key=len, reverse=True)
    breaks = {name: SCENES[next(kind for kind in kinds if name.endswith(kind))].breaks for name in data_of}
    return {f"valid/{name}.fcs": Vector(data, breaks[name]) for name, data in data_of.items()}


def samples_of(name: str, data: bytes) -> bytes:
    """Return reference Gaussians. Those of existing scenes are kept, because floats differ between machines."""
    scene, samples = VECTORS / name, VECTORS / samples_name(name)
    if samples.exists() and scene.exists() and scene.read_bytes() == data:
        return samples.read_bytes()
    return scene_samples(data, model_of(name))


def samples_name(name: str) -> str:
    return name.removesuffix(".fcs") + ".f32"


def is_scene(name: str) -> bool:
    return name.startswith("valid/scene-")


def expectation(vector: Vector) -> dict[str, Any]:
    """Return the expected content of a stream."""
    stream = read_stream(vector.data)
    header = stream.header
    return {
        "breaks": vector.breaks,
        "sha256": sha256(vector.data),
        "model_id": header.model_id.hex(),
        "size": [header.num_views, header.height, header.width],
        "lambda_q": [header.lambda_q_of_stage(stage + 1) for stage in range(header.num_stages)],
        "cameras": camera_fingerprint(stream.cameras),
        "coverage": None if stream.coverage is None else sha256(stream.coverage)[:16],
        "fading": None if stream.fading is None else sha256(stream.fading)[:16],
        "detail": detail_expectation(stream),
        "metadata": stream.metadata is not None,
        "stages": [
            {
                "payload_bytes": len(payload),
                "digest": digest.hex(),
                "symbols": [fingerprint(batch.ravel()) for batch in values.batches],
                "z_hat": fingerprint(values.z_hat),
                "y_hat": fingerprint(values.y_hat),
            }
            for payload, digest, values in zip(
                stream.payloads, header.symbol_digests, decode_symbols(stream), strict=True
            )
        ],
    }


def detail_expectation(stream: Stream) -> dict[str, Any] | None:
    """Return the expected detail of a stream, None if it has none."""
    detail, symbols = stream.detail, decode_detail_symbols(stream)
    if detail is None or symbols is None:
        return None
    return {"step": detail.step, "payload_bytes": len(detail.payload), "symbols": fingerprint(symbols.ravel())}


def changes_of(made: Mapping[str, bytes], here: Mapping[str, bytes]) -> dict[str, str]:
    """Return `new`, `changed` or `removed` by path."""
    return {
        name: "new    " if name not in here else "removed" if name not in made else "changed"
        for name in sorted(made.keys() | here.keys())
        if made.get(name) != here.get(name)
    }


def why_not(changes: Mapping[str, str], changelog: str, expected: dict[str, Any]) -> str | None:
    """Return a message about a missing version note, None if none is missing."""
    streams = {name: change.strip() for name, change in changes.items() if name.endswith(".fcs")}
    moved = [name for name, change in streams.items() if change != "new" and not is_scene(name)]
    if moved and newest_bits(changelog) == expected["bits"]:
        return (
            f"{moved[0]} is {streams[moved[0]]}, which changes the format; give it a new version and a `- BITS: ...` "
            "line in CHANGELOG.md, the first of its section, and run this again."
        )
    model_id = model_id_of((SHIPPED / DEFAULT_MODEL / RECEIVER_FILE).read_bytes()).hex()
    if any(is_scene(name) for name in streams) and expected["good"] and model_id not in changelog:
        return (
            f"the model {DEFAULT_MODEL} has the id {model_id}, which CHANGELOG.md does not name; add a line "
            f"`- BITS: weights {DEFAULT_MODEL}, model id {model_id}: ...` and run this again."
        )
    return None


def newest_bits(changelog: str) -> str:
    """Return the first `BITS` line that is not about weights."""
    lines = re.findall(r"^- BITS: (?!weights )(.+)$", changelog, re.MULTILINE)
    return lines[0] if lines else ""


def read_expected() -> dict[str, Any]:
    path = VECTORS / EXPECTED
    found: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    return found if "good" in found else {"bits": "", "good": {}, "faulty": {}}


def write(name: str, data: bytes | None) -> None:
    path = VECTORS / name
    if data is None:
        path.unlink()
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
