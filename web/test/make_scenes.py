"""Encode small scenes of one to sixteen views for the browser tests: `python -m web.test.make_scenes FOLDER`."""

import sys
from pathlib import Path

from fecocodec.sender.encode import encode
from tests.example_scenes import example_views

NUM_VIEWS = (1, 3, 8, 16)


def scene_name(num_views: int) -> str:
    return f"views-{num_views}.fcs"


if __name__ == "__main__":
    for count in NUM_VIEWS:
        data = encode(example_views(count, 64, 96), effort="fast")
        (Path(sys.argv[1]) / scene_name(count)).write_bytes(data)
