"""Fuzz `fecosplat decode`, networks included, with mutated scenes.

    python benchmarks/fuzz_command.py --files 2000
    python benchmarks/fuzz_command.py --files 50000 --small

The mutated streams are the released scene, or with --small streams of one to three drawn views of 64x64 pixels, which
decode in a fraction of the time. Few mutants pass the checks of the container and of the symbols, so with --small every
third file is a forgery instead: a valid stream of random symbols and cameras, which the whole receiver decodes.

Every call must write a PLY file of finite values (exit code 0, or 3 with `--partial`, which every other call uses), or
print one sentence and write nothing (exit code 1); a forgery must be decoded. Every call must end within MOST_SECONDS
of CPU time. Streams that violate this are saved to out/fuzz/, and the exit code of this script is 1.
"""

import argparse
import io
import sys
import tempfile
import time
from collections import Counter
from contextlib import redirect_stderr
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import torch  # noqa: E402
from fuzz_streams import keep  # noqa: E402

from cli.main import run  # noqa: E402
from fecocodec import encode, read_ply  # noqa: E402
from fecocodec.checkpoint import RECEIVER_FILE, model_folder  # noqa: E402
from fecocodec.container import read_prefix  # noqa: E402
from fecocodec.errors import FecoError  # noqa: E402
from fecocodec.receiver.model import load_receiver  # noqa: E402
from tests.example_scenes import example_views  # noqa: E402
from tests.fuzzing.forgeries import CodedLatents, code_random_latents, forged_stream  # noqa: E402
from tests.fuzzing.mutations import VECTORS, random_mutant  # noqa: E402
from tests.fuzzing.verdicts import MOST_PIXELS  # noqa: E402

MOST_SECONDS = 10.0
NUM_LATENTS = 200  # of forgeries, which differ in their cameras


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=2000, help="number of mutated files  [default: 2000]")
    parser.add_argument("--seed", type=int, default=0, help="seed of random numbers  [default: 0]")
    parser.add_argument("--small", action="store_true", help="mutate small streams that are encoded first")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after this time")
    options = parser.parse_args()
    torch.set_num_threads(1)
    scenes = small_streams() if options.small else released_streams()
    random, counts, slowest = Random(options.seed), Counter[str](), 0.0
    latents = coded_latents(random) if options.small else []
    end = time.monotonic() + 60 * options.minutes
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.files):
            if time.monotonic() > end:
                break
            is_forged = bool(latents) and number % 3 == 2
            data = forged_stream(random, latents) if is_forged else random_mutant(random, scenes)
            if is_large(data):
                counts["left out: larger than the scene"] += 1
                continue
            started = time.process_time()
            found = outcome(data, Path(folder), ("--partial",) if number % 2 else ())
            seconds = time.process_time() - started
            slowest = max(slowest, seconds)
            if is_forged:
                found = "forgery decoded" if found == "decoded" else f"WRONG forgery: {found}"
            if seconds > MOST_SECONDS:
                found = f"WRONG: {seconds:.1f} s: {found}"
            counts[found] += 1
            if found.startswith("WRONG"):
                keep(data, found)
            if number % 1000 == 999:
                print(f"{number + 1} files: {dict(counts.most_common())}, slowest {slowest:.2f} s", flush=True)
    print(f"{counts.total()} files: {dict(counts.most_common())}, slowest {slowest:.2f} s")
    return 1 if any(found.startswith("WRONG") for found in counts) else 0


def released_streams() -> list[bytes]:
    """Return the streams of released models."""
    return [path.read_bytes() for path in sorted(VECTORS.glob("valid/scene-*.fcs"))]


def small_streams() -> list[bytes]:
    """Return streams of one to three views of 64x64 pixels, encoded with the default model, and one of one stage."""
    scenes = [encode(example_views(views), effort="fast") for views in (1, 2, 3)]
    return [*scenes, encode(example_views(2), effort="fast", num_stages=1)]


def coded_latents(random: Random) -> list[CodedLatents]:
    """Return random latents, coded with the default model."""
    receiver, model_id = load_receiver(model_folder(None) / RECEIVER_FILE)
    return [code_random_latents(random, receiver, model_id) for _ in range(NUM_LATENTS)]


def is_large(data: bytes) -> bool:
    """Return whether the header declares more pixels than the original scenes; decoding would only take longer."""
    try:
        header = read_prefix(data, 1).header
    except FecoError:
        return False
    return header.num_pixels > MOST_PIXELS


def outcome(data: bytes, folder: Path, options: tuple[str, ...]) -> str:
    """Run the command; return "refused", "decoded", "partly decoded", or "WRONG" with the reason."""
    source, output = folder / "scene.fcs", folder / "output" / "scene.ply"
    output.parent.mkdir(exist_ok=True)
    source.write_bytes(data)
    stderr = io.StringIO()
    with redirect_stderr(stderr):
        code = run(["decode", str(source), "-o", str(output), *options])
    if code == 1:
        is_sentence = stderr.getvalue().count("\n") == 1 and stderr.getvalue().startswith("fecosplat: ")
        is_empty = not any(output.parent.iterdir())
        return "refused" if is_sentence and is_empty else f"WRONG refusal: {stderr.getvalue()}"
    if code not in (0, 3) or not is_finite(output):
        return f"WRONG: exit code {code}: {stderr.getvalue()}"
    output.unlink()
    return "decoded" if code == 0 else "partly decoded"


def is_finite(path: Path) -> bool:
    """Return whether the PLY file exists and all its values are finite."""
    return path.exists() and all(bool(field.isfinite().all()) for field in read_ply(path).fields())


if __name__ == "__main__":
    sys.exit(main())
