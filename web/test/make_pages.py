"""Write pages for the browser tests: `python -m web.test.make_pages FOLDER`.

`scene.html` is that of a decoded scene, `ply.html` and `spz.html` are those of files of its Gaussians alone.
"""

import sys
from pathlib import Path

from fecocodec import decode
from fecocodec.splat_files.gaussian_files import decoded_file
from fecocodec.splat_files.html_page import page_of_file
from tests.vectors.tiny_model import VECTORS

STREAM = VECTORS / "valid/scene-compact-6.fcs"

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    decoded = decode(STREAM.read_bytes(), is_merged=False)
    (folder / "scene.html").write_bytes(decoded_file(decoded, Path("scene.html")).data)
    for kind in ("ply", "spz"):
        path = Path(f"scene.{kind}")
        data = decoded_file(decoded, path, frame="first-camera").data
        (folder / f"{kind}.html").write_bytes(page_of_file(path, data))
