"""The page of a decoded scene holds its name, cameras and Gaussians."""

import base64
import gzip
import json
import re

from fecocodec.splat_files.gaussian_arrays import OutputScene
from fecocodec.splat_files.html_page import file_bytes
from fecocodec.splat_files.spz import spz_bytes
from tests.splat_files.test_output_formats import some_cameras, some_gaussians

CONTENT = r'<script type="[a-z/]+" id="{}">([^<]*)</script>'


def content_of(page: str, name: str) -> str:
    found = re.findall(CONTENT.format(name), page)
    assert len(found) == 1
    return found[0]


def test_the_page_holds_the_scene() -> None:
    """A name can neither end a script nor look like the mark of another part."""
    gaussians, cameras, name = some_gaussians(100), some_cameras(), "</script><b>\x1b/*GAUSSIANS*/<!--"
    page = file_bytes(OutputScene(gaussians, cameras, name, "scene.html")).decode("utf-8")
    scene = json.loads(content_of(page, "scene"))
    assert scene["name"] == name and "\x1b" not in page
    assert scene["count"] == gaussians.count
    assert (scene["height"], scene["width"]) == cameras.image_size
    assert [view["centre"] for view in scene["cameras"]["views"]] == cameras.extrinsics[:, :3, 3].tolist()
    assert gzip.decompress(base64.b64decode(content_of(page, "gaussians"))) == gzip.decompress(
        spz_bytes(gaussians, "scene.html", 3)
    )
    assert "connect-src data: blob:" in page
