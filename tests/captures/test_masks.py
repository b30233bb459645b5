"""Masks: which file is that of a photograph, which pixels it marks, and what becomes of them."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from wall_scene import edited, shots, write_colmap_text, write_transforms

from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError
from fecocodec.geometry.coding_grid import filled
from fecocodec.photographs.masks import find_mask, read_mask
from fecocodec.poses.unposed_photographs import upright_copies, upright_masks

read = partial(read_views, near=1.0, far=9.0)


def store_mask(path: Path, size: tuple[int, int] = (96, 80), *, kept: int = 255) -> None:
    """Black in the left half."""
    path.parent.mkdir(parents=True, exist_ok=True)
    levels = np.zeros((size[1], size[0]), np.uint8)
    levels[:, size[0] // 2 :] = kept
    Image.fromarray(levels).save(path)


def left_half(height: int, width: int) -> torch.Tensor:
    return (torch.arange(width) < width // 2).expand(height, width)


FOUND = [
    "masks/000.png.png",
    "masks/000.png",
    "images/masks/000.png",
    "Masks/000.PNG",
    "mask/000_mask.jpg",
    "masks_2/000.png",
]


@pytest.mark.parametrize(
    ("write", "name"),
    [(write, name) for write in (write_transforms, write_colmap_text) for name in FOUND]
    + [(write_transforms, "other/a.png")],  # COLMAP's models name no masks
)
def test_black_pixels_are_ignored(write, name, tmp_path):
    folder = write(tmp_path / "scene", shots(2))
    store_mask(folder / name)
    if name.startswith("other"):
        with edited(folder) as scene:
            scene["frames"][0]["mask_path"] = name
    views = read(folder)
    assert torch.equal(views.ignored[0], left_half(80, 96)) and not views.ignored[1].any()
    assert torch.equal(views.select([1, 0]).ignored, views.ignored.flip(0))
    assert views.alpha is None
    masked, *unmasked = views.remarks
    assert masked == "masks of 1 photograph mark 50% of their pixels, which are left out."
    beside = f"{(folder / name).parent} has no mask for 1 photograph, such as 001.png; name a mask 001.png.png."
    assert unmasked == ([] if name.startswith("other") else [beside])
    plain = read(folder, masks="unused").images
    assert torch.equal(views.images == plain, ~views.ignored[:, None] | (views.images == plain))
    assert torch.equal(views.images[0, :, :, :40], filled(plain, views.ignored)[0, :, :, :40])


@pytest.mark.parametrize("named", ["/home/me/scan/other/a.PNG", "other\\a.jpg", "Other/a.png"])
def test_masks_that_are_named_are_found_as_photographs_are(named, tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    store_mask(folder / "other" / "a.png")
    with edited(folder) as scene:
        scene["frames"][0]["mask_path"] = named
        scene["frames"][1]["mask_path"] = "masks/001.png"  # no such mask, and not the photograph 001.png
    assert torch.equal(read(folder, views=(0,)).ignored[0], left_half(80, 96))
    with pytest.raises(InputError, match=r"001\.png: no such image"):
        read(folder, views=(1,))
    for name in ("m\0.png", "m\ud83d.png"):
        scene["frames"][1]["mask_path"] = name
        (folder / "transforms.json").write_text(json.dumps(scene))
        with pytest.raises(InputError, match="no file can have such a name"):
            read(folder, views=(1,))
    scene["frames"][1]["mask_path"] = 1
    (folder / "transforms.json").write_text(json.dumps(scene))
    with pytest.raises(InputError, match=r"frame 1 \(.*\): `mask_path` is not text; name the mask of this image"):
        read(folder, views=(1,))


def test_masks_of_reduced_photographs_are_those_of_the_names(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    (folder / "images").rename(folder / "images_2")
    for name in ("000.png", "001.png"):
        store_mask(folder / "masks_2" / name)
    with edited(folder) as scene:
        for frame in scene["frames"]:
            frame["mask_path"] = frame["file_path"].replace("images", "masks")
    assert torch.equal(read(folder).ignored[1], left_half(80, 96))


@pytest.mark.parametrize(
    "name", ["images/000_mask.png", "images/mask-000.png", "images_masks/000.png.png", "dynamic_masks/000.png"]
)
def test_masks_that_are_not_read_are_named(name, tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    store_mask(folder / "alpha" / "002.png")  # of no photograph
    remedy = "put masks into a folder masks beside that of the photographs."
    assert read(folder).remarks == ()
    assert read(folder, masks="cut-out").remarks == (f"no photograph has a mask to cut it out by; {remedy}",)
    store_mask(folder / name)
    views = read(folder)
    assert views.remarks == (f"{folder / name} is a mask by its name or folder, and is not read; {remedy}",)
    assert views.ignored is None and read(folder, masks="unused").remarks == ()


def test_what_is_black_is_marked(tmp_path):
    pixels = np.zeros((80, 96, 4), np.uint8)  # black, and opaque on the right
    pixels[:, 48:, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "mask.png")
    assert torch.equal(read_mask(tmp_path / "mask.png", 80, 96), left_half(80, 96))
    store_mask(tmp_path / "mask.png")
    Image.open(tmp_path / "mask.png").save(tmp_path / "mask.jpg", quality=50)
    assert torch.equal(read_mask(tmp_path / "mask.jpg", 80, 96), left_half(80, 96))
    store_mask(tmp_path / "mask.png", kept=1)
    assert torch.equal(read_mask(tmp_path / "mask.png", 80, 96), left_half(80, 96))
    Image.new("L", (96, 80), 0).save(tmp_path / "mask.png")
    assert read_mask(tmp_path / "mask.png", 80, 96).all()
    store_mask(tmp_path / "mask.png", (80, 96))
    with pytest.raises(InputError) as caught:
        read_mask(tmp_path / "mask.png", 80, 96)
    assert str(caught.value) == (
        f"{tmp_path / 'mask.png'}: the mask has 80x96 pixels and its photograph 96x80; give it the shape of the "
        "photograph."
    )


def test_masks_are_cropped_and_resized_with_their_photographs(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    store_mask(folder / "masks" / "000.png", (192, 160))
    ignored = read(folder, size=(64, 64)).ignored[0]
    assert ignored.shape == (64, 64) and ignored[:, :32].all() and not ignored[:, 33:].any()


def test_a_cut_out_is_transparent(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    store_mask(folder / "masks" / "000.png")
    views, plain = read(folder, masks="cut-out"), read(folder, masks="unused")
    black = left_half(80, 96)
    assert views.ignored is None and torch.equal(views.alpha, torch.stack(((~black).float(), torch.ones(80, 96))))
    assert torch.equal(views.images[0], torch.where(black, 1.0, plain.images[0]))
    assert views.remarks[0] == "masks of 1 photograph mark 50% of their pixels, which become transparent."
    on_black = read(folder, masks="cut-out", background="black")
    assert on_black.alpha is None and torch.equal(on_black.images[0], torch.where(black, 0.0, plain.images[0]))


def test_a_photograph_of_which_nothing_is_left_is_refused(tmp_path):
    folder = write_transforms(tmp_path / "scene", shots(2))
    store_mask(folder / "masks" / "000.png", kept=0)
    with pytest.raises(InputError, match=r"masks/000\.png: the mask marks every pixel of 000\.png; correct it, or"):
        read(folder)
    assert read(folder, masks="cut-out").alpha is not None and read(folder, masks="unused").ignored is None


def test_names_so_long_that_no_mask_can_be_called_so(tmp_path):
    folder = write_transforms(tmp_path, [replace(shots(1)[0], name="n" * 251 + ".png")])
    store_mask(folder / "masks" / "other.png")
    assert read(folder).ignored is None
    (folder / "images" / "masks").mkdir()
    photographs = list((folder / "images").glob("*.png"))
    store_mask(folder / "masks" / photographs[0].name)
    (tmp_path / "copies").mkdir()
    upright_copies(photographs, tmp_path / "copies")
    with pytest.raises(InputError, match=r"n\.png: the name is too long for that of a mask; shorten it\.$"):
        upright_masks(photographs, tmp_path / "copies")


def test_masks_lie_in_the_same_subfolders_as_photographs(tmp_path):
    for name in ("images/cam1/a.jpg", "masks/cam1/a.jpg.png", "images/cam2/a.jpg"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert find_mask(tmp_path / "images/cam1/a.jpg") == tmp_path / "masks/cam1/a.jpg.png"
    assert find_mask(tmp_path / "images/cam2/a.jpg") is None
