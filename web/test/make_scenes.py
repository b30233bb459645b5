"""Encode small scenes of one to sixteen views for the browser tests: `python -m web.test.make_scenes FOLDER`.

The scene of three views has a fading section with all levels.
"""

import sys
from dataclasses import replace
from math import prod
from pathlib import Path

from fecocodec.container import FADING_BLOCKS, read_stream, write_stream
from fecocodec.sender.encode import encode
from tests.example_scenes import example_views

NUM_VIEWS = (1, 3, 8, 16)
FADED = 3


def scene_name(num_views: int) -> str:
    return f"views-{num_views}.fcs"


def with_fading(data: bytes) -> bytes:
    stream = read_stream(data)
    num_bytes = prod(FADING_BLOCKS.shape(stream.header)) // 4
    return write_stream(replace(stream, fading=bytes(37 * at % 256 for at in range(num_bytes))))


if __name__ == "__main__":
    for count in NUM_VIEWS:
        data = encode(example_views(count, 64, 96), effort="fast")
        (Path(sys.argv[1]) / scene_name(count)).write_bytes(with_fading(data) if count == FADED else data)
