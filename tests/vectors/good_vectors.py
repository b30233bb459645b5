"""The streams under valid/ and uncommon/, each with the kind of faulty reader that it detects."""

from dataclasses import dataclass, replace

from fecocodec.container import FormatVersion, Stream, list_sections, write_stream
from tests.container.example_streams import TURNED, float32, pose, sealed_header, sealed_section
from tests.vectors.chosen_symbols import (
    LENS,
    Recipe,
    around_the_escape,
    cameras_of,
    lowest,
    sparse,
    stream_of_recipe,
    zero,
)
from tests.vectors.paper_model import paper_model_id


@dataclass(frozen=True)
class Vector:
    """A stream, and one line about the kind of faulty reader that it detects."""

    data: bytes
    breaks: str


BASE = Recipe(cameras=cameras_of(2, shares_lens=False), metadata={"name": "tiny", "made": [2026, 11]})
THREE = cameras_of(3)

VALID: dict[str, tuple[Recipe, str]] = {
    "two-views": (BASE, "any that takes words of a payload from its beginning"),
    "one-stage": (replace(BASE, num_stages=1, seed=2), "one that expects two digests, or a B2"),
    "shared-lens": (Recipe(cameras=THREE, seed=3), "one that expects intrinsics for every view"),
    "five-views": (Recipe(64, 64, 700, cameras_of(5), seed=4), "one that walks views before phases"),
    "portrait": (Recipe(96, 64, seed=5), "one that mixes up height and width"),
    "landscape": (Recipe(64, 128, seed=6), "one that mixes up rows and columns of the quadtree"),
    "fine": (Recipe(lambda_q=0 + 281, seed=7), "one that takes lambda_q for a number without sign in the condition"),
    "coarse": (Recipe(lambda_q=1600, seed=8), "one that clips the condition to 8 bits"),
    "coarser-first-stage": (Recipe(lambda_q=700, excess=229, seed=14), "one that codes both stages at one lambda_q"),
    "coverage": (Recipe(covers=3, seed=12), "one that counts cells of the image, or from the lowest bit"),
    "fading": (
        Recipe(fades=True, covers=5, seed=15),
        "one that counts blocks of the image, or takes levels from the lowest bits",
    ),
    "metadata": (
        Recipe(metadata={"text": "größer \u2713", "list": [[1, 2.5], None, True], "empty": {}}, seed=13),
        "one that takes metadata for ASCII",
    ),
    "detail": (
        Recipe(detail_step=20, seed=16),
        "one that takes contexts from the coded plane, or all planes as one batch",
    ),
    "detail-of-one-stage": (
        Recipe(64, 128, cameras=THREE, num_stages=1, choose=sparse, detail_step=37, seed=17),
        "one that expects detail after B2 only, or adds up magnitudes across borders of rows and views",
    ),
    "paper": (
        Recipe(64, 96, seed=42, model_id=paper_model_id()),
        "one that applies the rules of FORMAT.md, section 9.1, to a model of the paper's method",
    ),
}

_far = replace(
    cameras_of(2),
    extrinsics=(pose(TURNED, (2.0**54, -(2.0**54), 0.0)), pose(TURNED, (0.0, 2.0**-100, -0.0))),
    intrinsics=((2.0**-6, 2.0**8, -(2.0**8), 2.0**8), LENS),
    near=2.0**40,
    far=2.0**54,
)
_small = replace(
    cameras_of(2), extrinsics=cameras_of(2).extrinsics[:1] * 2, near=2.0**-40, far=2.0**-40 * (1 + 2.0**-9)
)
_loose = replace(
    cameras_of(2),
    extrinsics=(pose(tuple(float32(1.0004 * value) for value in TURNED), (1.0, 2.0, 3.0)), pose(TURNED, (0, 0, 0))),
)
_same = replace(cameras_of(3), extrinsics=cameras_of(3).extrinsics[:1] * 3)
_nested = {"a": [[[[[[["deep"]]]]]]], "zeros": "0" * 60_000, "escape": "\x1b[31m\x00"}

UNCOMMON: dict[str, tuple[Recipe, str]] = {
    "one-view": (Recipe(cameras=cameras_of(1), seed=20), "one that stacks views"),
    "sixteen-views": (Recipe(64, 64, 1000, cameras_of(16), seed=21), "one that has room for fewer views"),
    "odd-sides": (Recipe(81, 79, seed=22), "one that rounds sides down, or up"),
    "smallest": (Recipe(64, 64, cameras=cameras_of(1), seed=23), "one that needs neighbours"),
    "tallest": (Recipe(1024, 64, 1500, cameras_of(1), seed=24), "one that keeps a side in 10 bits"),
    "widest": (Recipe(64, 1024, 1500, cameras_of(1), num_stages=1, seed=25), "one that keeps a side in 10 bits"),
    "lambda-lowest": (Recipe(lambda_q=0, seed=26), "one whose condition is not negative"),
    "lambda-highest": (Recipe(lambda_q=1768, seed=27), "one that keeps lambda_q in 10 bits"),
    "largest-excess": (Recipe(lambda_q=1768, excess=255, seed=35), "one that takes the excess for a signed byte"),
    "all-symbols-zero": (Recipe(choose=zero, seed=28), "one that takes a symbol of zero for a value of zero"),
    "escapes": (
        Recipe(choose=around_the_escape, seed=29),
        "one that keeps values in 16 bits, or takes mantissas and exponents in turns",
    ),
    "empty-payloads": (
        Recipe(choose=lowest, detail_step=21, seed=37),
        "one that takes an empty payload for no symbols, or for symbols of zero",
    ),
    "detail-all-symbols-zero": (
        Recipe(choose=zero, detail_step=0, seed=38),
        "one that takes a step of 0 for no detail",
    ),
    "detail-escapes": (
        Recipe(cameras=cameras_of(1), choose=around_the_escape, detail_step=63, seed=39),
        "one whose contexts count magnitudes above 15 in full",
    ),
    "detail-and-all-other-sections": (
        Recipe(96, 64, covers=4, fades=True, metadata={"name": "all"}, detail_step=8, seed=40),
        "one that expects detail at a certain number of sections",
    ),
    "identical-views": (Recipe(cameras=_same, seed=30), "one that divides by a baseline"),
    "cameras-at-the-limits": (Recipe(cameras=_far, seed=31), "one that squares lengths in float16, or drops -0"),
    "rotation-barely-one": (Recipe(cameras=_loose, seed=32), "one that rebuilds rotations as exact ones"),
    "depth-range-at-the-limits": (Recipe(cameras=_small, seed=36), "one whose rounded far is near"),
    "nothing-covered": (Recipe(covers=0, seed=33), "one that cannot write a scene without Gaussians"),
    "metadata-at-the-limits": (Recipe(metadata=_nested, seed=34), "one that shows control characters as they are"),
}


def good_vectors() -> dict[str, Vector]:
    """Return the streams by path below vectors/, without the scenes of released models."""
    found = {}
    for folder, recipes in (("valid", VALID), ("uncommon", UNCOMMON)):
        for name, (recipe, breaks) in recipes.items():
            found[f"{folder}/{name}.fcs"] = Vector(write_stream(stream_of_recipe(recipe)), breaks)
    return found | {f"uncommon/{name}.fcs": vector for name, vector in _from_the_future().items()}


def _from_the_future() -> dict[str, Vector]:
    """Return a stream of a newer minor version, which this version must read, and streams with unknown sections."""
    stream = stream_of_recipe(BASE)
    newer = write_stream(replace(stream, header=replace(stream.header, version=FormatVersion(2, 255))))
    most = (0x01, 0x11, 0x12, 0x21, 0x22, 0x23, 0x31, 0x41, 0x42, 0x43, 0x44, 0x7E, 0x7F)
    many = _with_sections(replace(stream, metadata=None), most)
    beside_detail = _with_sections(stream_of_recipe(replace(BASE, detail_step=30, seed=41)), (0x37, 0x39, 0x3F))
    return {
        "newer-minor-version": Vector(newer, "one that reads only the minor version that it knows"),
        "unknown-sections": Vector(many, "one that stops at a section it does not know"),
        "detail-among-unknown-sections": Vector(beside_detail, "one that expects detail right after B2"),
    }


def _with_sections(stream: Stream, kinds: tuple[int, ...]) -> bytes:
    """Return a stream with unknown, skippable sections of these kinds among its own."""
    whole = write_stream(stream)
    sections = [sealed_section(kind, bytes(range(kind % 7))) for kind in kinds]
    for section in list_sections(whole):
        sections.append(whole[section.offset : section.offset + section.total_bytes])
    ordered = sorted(sections, key=lambda section: section[0] & 0x7F)
    return sealed_header(stream.header, sections=len(ordered)) + b"".join(ordered)
