"""Text that is no table of cameras, and tables with flaws of spreadsheets or of several in one folder."""

from pathlib import Path

import pytest
from wall_scene import shots, write_colmap_text, write_realestate10k

from fecocodec.camera_files.find import has_cameras
from fecocodec.captures.chosen_photographs import choose_photographs
from fecocodec.errors import InputError


def test_a_table_of_images_without_one_of_cameras_is_one_of_colmap(tmp_path: Path) -> None:
    folder = write_colmap_text(tmp_path, shots(2))
    (folder / "sparse" / "0" / "cameras.txt").unlink()
    assert has_cameras(folder)
    with pytest.raises(InputError, match=r"cameras\.txt: cannot be read"):
        choose_photographs(folder)


@pytest.mark.parametrize(("old", "new"), [(" ", ","), (".", ",")])
def test_commas_in_tables_of_colmap_are_the_cause(old: str, new: str, tmp_path: Path) -> None:
    table = write_colmap_text(tmp_path, shots(2)) / "sparse" / "0" / "images.txt"
    table.write_text(table.read_text().replace(old, new))
    with pytest.raises(InputError, match="and it has commas, which must be spaces or points; export the model again"):
        choose_photographs(tmp_path)


def test_further_texts_of_realestate10k_are_named(tmp_path: Path) -> None:
    folder = write_realestate10k(tmp_path, shots(4))
    lines = (folder / "clip.txt").read_text().splitlines(keepends=True)
    (folder / "a.txt").write_text("".join(lines[:3]))
    (folder / "b.txt").write_text("".join(line.replace("00", "9", 1) for line in lines[3:]))
    (folder / "clip.txt").write_text("".join(lines[3:]))
    chosen = choose_photographs(folder)
    assert len(chosen.names) == 2 and chosen.notes == ()  # the others have cameras in `clip.txt`
    assert chosen.remarks == (
        "b.txt, clip.txt have cameras, too, which are not used; give one of them in place of the folder to use it.",
    )
    (folder / "a.txt").unlink()
    assert choose_photographs(folder).scene.cameras_path == folder / "clip.txt"  # the images of `b.txt` are not here
