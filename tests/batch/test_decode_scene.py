"""Decoded files of a batch note what `fecosplat decode` says about them."""

from pathlib import Path

import numpy as np
import pytest

from fecocodec.batch.decode_scene import DecodeScene
from fecocodec.decoding import Decoded
from fecocodec.geometry.gaussian_arrays import SceneCameras
from tests.splat_files.test_output_formats import some_gaussians
from tests.vectors.tiny_model import VECTORS

UPSIDE_DOWN = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize(("suffix", "has_note"), [(".ply", False), (".glb", True)])
def test_a_scene_that_does_not_show_which_way_is_up_is_noted_where_it_should_stand(suffix: str, has_note: bool) -> None:
    extrinsics = np.stack((np.eye(4), UPSIDE_DOWN)).astype(np.float32)
    intrinsics = np.tile(np.diag([1.0, 1.0, 1.0]).astype(np.float32), (2, 1, 1))
    decoded = Decoded(some_gaussians(10), SceneCameras(extrinsics, intrinsics, 1.0, 10.0), (64, 64), 2, None)
    result = DecodeScene(suffix, lambda data: decoded).run(Path(VECTORS / "valid/two-views.fcs"), "a")
    assert result.details.get("notes") == (
        ["the cameras do not agree on which way is up, so the up direction of the first one is taken."]
        if has_note
        else None
    )
