"""The streams under faulty/: each breaks one rule of the specification and is valid otherwise."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from unittest.mock import patch

from fecocodec.container import Stream, write_stream
from fecocodec.container.detail_section import Detail
from tests.container.faulty_streams import faults_of
from tests.vectors.chosen_symbols import Recipe, stream_of_recipe
from tests.vectors.good_vectors import BASE, VALID
from tests.vectors.paper_model import paper_model_id


@dataclass(frozen=True)
class FaultyVector:
    """A faulty stream. rule: of FORMAT.md or ENTROPY.md. says: expected part of the error message."""

    data: bytes
    rule: str
    says: str


def faulty_vectors() -> dict[str, FaultyVector]:
    """Return the streams by path below vectors/."""
    good = stream_of_recipe(BASE)
    found: dict[str, FaultyVector] = {}
    for fault in faults_of(good):
        found[_path(fault.rule, found)] = FaultyVector(fault.data, fault.rule, fault.cause)
    for vector in (*payload_faults(good), *detail_faults(), *digest_faults(good), *model_faults(good)):
        found[_path(vector.rule, found)] = vector
    return found


def _path(rule: str, taken: dict[str, FaultyVector]) -> str:
    slug = re.sub("[^a-z0-9]+", "-", rule.lower()).strip("-")
    number = sum(vector.rule == rule for vector in taken.values()) + 1
    return f"faulty/{slug}{f'-{number}' if number > 1 else ''}.fcs"


def with_payload(stream: Stream, stage: int, payload: bytes) -> bytes:
    payloads = list(stream.payloads)
    payloads[stage - 1] = payload
    return write_stream(replace(stream, payloads=tuple(payloads)))


def payload_faults(good: Stream) -> list[FaultyVector]:
    """Return faults of payloads (ENTROPY.md, section 9)."""
    first, second = good.payloads
    words, end = "whole words, the last not 0", "state 0 and no words at the end"
    bad_words, no_end = "are not 32-bit words of which the last is not zero", "do not end together"
    faults: list[tuple[str, int, bytes, str]] = [
        (words, 1, first + b"\1", bad_words),
        (words, 2, second[:-1], bad_words),
        (words, 1, first + bytes(4), bad_words),
        ("exponent at most 19", 1, b"\xff" * 200, "an escape has the exponent"),
        (end, 2, b"\1\0\0\0" + second, no_end),
        (end, 2, second[4:], no_end),
    ]
    bad = [FaultyVector(with_payload(good, stage, payload), rule, says) for rule, stage, payload, says in faults]
    return [*bad, FaultyVector(_too_large(), "magnitude at most 2^20", "at most 1048576 is allowed")]


def detail_faults() -> list[FaultyVector]:
    """Return faults of the payload of detail, after stages without a fault."""
    stream = stream_of_recipe(Recipe(64, 64, detail_step=20))
    assert stream.detail is not None
    payload = stream.detail.payload
    words, end = "whole words, the last not 0", "state 0 and no words at the end"
    bad_words, no_end = "are not 32-bit words of which the last is not zero", "do not end together"
    faults = [
        (words, payload[:-1], bad_words),
        (words, payload + bytes(4), bad_words),
        ("exponent at most 19", b"\xff" * 2000, "an escape has the exponent"),
        (end, b"\1\0\0\0", no_end),
        (end, payload[4:], no_end),
    ]
    return [
        FaultyVector(write_stream(replace(stream, detail=replace(stream.detail, payload=bad))), rule, says)
        for rule, bad, says in faults
    ]


def _too_large() -> bytes:
    """Code a symbol that the escape code can represent and the format forbids, with a writer of another limit."""
    choose: Callable[..., int] = lambda random, table: 2**20 + 1  # noqa: E731
    with patch("fecocodec.entropy.symbol_coders.SYMBOL_LIMIT", 2**21):
        return write_stream(stream_of_recipe(Recipe(64, 64, choose=choose)))


def digest_faults(good: Stream) -> list[FaultyVector]:
    first, second = good.header.symbol_digests
    no_symbols = (good.payloads[0], b"")
    return [
        FaultyVector(write_stream(stream), "digest", says)
        for stream, says in (
            (replace(good, header=replace(good.header, symbol_digests=(bytes(8), second))), "stage 1: the decoded"),
            (replace(good, header=replace(good.header, symbol_digests=(first, bytes(8)))), "stage 2: the decoded"),
            (replace(good, payloads=no_symbols), "stage 2: the decoded"),
        )
    ]


def model_faults(good: Stream) -> list[FaultyVector]:
    other = replace(good, header=replace(good.header, model_id=bytes(8)))
    without = replace(stream_of_recipe(VALID["paper"][0]), detail=Detail(20, b""))
    says = f"the model {paper_model_id().hex()} has no detail"
    return [
        FaultyVector(write_stream(other), "model id", f"the receiver weights with model id {bytes(8).hex()}"),
        FaultyVector(write_stream(without), "the model has detail", says),
    ]
