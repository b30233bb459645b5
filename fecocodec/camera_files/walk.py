"""The files in and below a folder, without walking through huge trees."""

import os
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

DEPTH = 5  # of a file: output/colmap/sparse/0/images.bin
_MOST_FOLDERS = 400
_MOST_ENTRIES = 20_000  # of a folder


def walk(folder: Path, depth: int = DEPTH) -> Iterator[Path]:
    """Yield files and folders up to `depth` levels below a folder, the nearest first, then by name.

    Hidden ones are left out, and so is a folder that was met before, by a link. Of huge trees, some are left out.
    """
    level, met = [folder], {folder.resolve()}
    for further in range(depth, 0, -1):
        below = list[Path]()
        for place in level:
            with suppress(OSError), os.scandir(place) as entries:
                for name, is_folder in sorted((one.name, one.is_dir()) for one in islice(entries, _MOST_ENTRIES)):
                    if name.startswith("."):
                        continue
                    yield place / name
                    if is_folder and further > 1 and len(met) < _MOST_FOLDERS and (place / name).resolve() not in met:
                        met.add((place / name).resolve())
                        below.append(place / name)
        level = below
