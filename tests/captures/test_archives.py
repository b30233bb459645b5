"""ZIP archives of photographs are read like the folder that was packed."""

import errno
import os
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from wall_scene import shots, write_colmap_binary, write_photographs, write_transforms

from fecocodec.camera_files.unused_cameras import unread_cameras_notes
from fecocodec.captures import archives
from fecocodec.captures.archives import unpacked
from fecocodec.captures.render_cameras import read_render_cameras
from fecocodec.captures.scene_folder import read_views
from fecocodec.errors import InputError, OutputError, SizeError


def pack(folder: Path, archive: Path, prefix: str = "") -> Path:
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                packed.write(path, prefix + path.relative_to(folder).as_posix())
    return archive


@pytest.mark.parametrize("prefix", ["", "my scan/", "a/b/"])
@pytest.mark.parametrize("write", [write_transforms, write_colmap_binary])
def test_an_archive_is_read_like_its_folder(write, prefix, tmp_path: Path) -> None:
    folder = write(tmp_path / "scene", shots(2))
    archive = pack(folder, tmp_path / "scan.ZIP", prefix)
    expected, found = read_views(folder, near=1.0, far=9.0), read_views(archive, near=1.0, far=9.0)
    assert torch.equal(found.images, expected.images)
    assert (found.names, found.notes) == (expected.names, ())
    assert torch.equal(read_render_cameras(archive).cameras.extrinsics, expected.cameras.extrinsics)
    with zipfile.ZipFile(archive, "a") as packed:  # beside the folder of the scene, if it has one
        packed.writestr("README.txt", "Thank you.")
        packed.writestr("licence.json", "{}")
    assert read_views(archive, near=1.0, far=9.0).names == expected.names


@pytest.mark.parametrize("name", ["room.log", "export.psx", "my_poses.yaml"])
def test_cameras_that_are_not_read_are_named(name: str, tmp_path: Path) -> None:
    folder = write_transforms(tmp_path / "scene", shots(2))
    (folder / name).write_text("0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    (remark,) = read_views(pack(folder, tmp_path / "scan.zip"), near=1.0, far=9.0).remarks
    assert remark.startswith(f"cameras in {name} ") and remark.endswith(
        "are not read; those of transforms.json are used."
    )


def test_photographs_without_cameras_are_unpacked_without_rubbish(tmp_path: Path) -> None:
    write_photographs(tmp_path / "scene", shots(2))
    for name in ("__MACOSX/._000.png", ".DS_Store", "._000.png", "video.mp4", "mesh.ply"):
        (tmp_path / "scene" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "scene" / name).write_bytes(b"x")
    with unpacked(pack(tmp_path / "scene", tmp_path / "a.zip", "photos/")) as folder:
        assert sorted(path.name for path in folder.rglob("*")) == ["000.png", "001.png"]
    assert not folder.exists()
    with unpacked(tmp_path / "scene") as folder:
        assert folder == tmp_path / "scene"


def test_errors_name_the_archive_and_what_is_to_be_unpacked(tmp_path: Path) -> None:
    for name in ("a", "b"):
        folder = write_transforms(tmp_path / "scans" / name, shots(2))
    archive = pack(tmp_path / "scans", tmp_path / "scans.zip")
    with pytest.raises(InputError, match=rf"2 folders with cameras; unpack it and give one of them, as {archive}/a\.$"):
        read_views(archive)
    (folder / "images" / "001.png").write_bytes(b"no image")
    archive = pack(folder, tmp_path / "a.zip", "scene/")
    with pytest.raises(InputError) as refused:
        read_views(archive, near=1.0, far=9.0)
    assert str(refused.value).startswith(f"{archive}/images/001.png: the image is damaged")
    with pytest.raises(SizeError, match=f"^{archive}: too large") as too_large, unpacked(archive) as root:
        raise SizeError(f"{root}: too large.", 20.0)
    assert too_large.value.kib == 20.0


def test_archives_that_cannot_be_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = tmp_path / "a.zip"
    for content, cause in ((b"no zip", "cannot be unpacked (File is not a zip file)"), (b"", "cannot be unpacked (")):
        archive.write_bytes(content)
        with pytest.raises(InputError) as refused:
            read_views(archive)
        assert str(refused.value).startswith(f"{archive}: the ZIP archive {cause}")
        assert str(refused.value).endswith("; it is damaged or no ZIP archive: copy it again.")
    pack(write_transforms(tmp_path / "scene", shots(2)), archive)
    whole = archive.read_bytes()
    archive.write_bytes(whole.replace(whole[60:90], os.urandom(30)))  # data of a member
    with pytest.raises(InputError, match="the ZIP archive cannot be unpacked"):
        read_views(archive)
    archive.write_bytes(whole)
    monkeypatch.setattr(archives, "MAX_TOTAL_BYTES", 1000)
    with pytest.raises(InputError, match="the ZIP archive holds too many or too large files; unpack it"):
        read_views(archive)


@pytest.mark.parametrize("name", ["../a.png", "/a.png", "C:/a.png", "b/../../a.png", "..\\a.png"])
def test_members_that_lead_out(name: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        packed.writestr(name, b"x")
    with pytest.raises(InputError, match="leads out of the archive; unpack it and give the folder"):
        read_views(tmp_path / "a.zip")


def test_encrypted_archives_and_links(tmp_path: Path) -> None:
    archive = tmp_path / "a.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        link = zipfile.ZipInfo("a.png")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        packed.writestr(link, "/etc/passwd")
        packed.writestr("b.png", np.zeros(3).tobytes())
    with unpacked(archive) as folder:
        assert [path.name for path in folder.iterdir()] == ["b.png"]
    data = bytearray(archive.read_bytes())
    data[data.rindex(b"PK\1\2") + 8] |= 1  # the flag of b.png in the directory
    archive.write_bytes(data)
    with pytest.raises(InputError, match="the ZIP archive is encrypted; unpack it and give the folder"):
        read_views(archive)


def test_a_full_disk_is_not_a_fault_of_the_archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    write_transforms(tmp_path / "scene", shots(2))
    archive = pack(tmp_path / "scene", tmp_path / "a.zip")
    monkeypatch.setattr(archives, "copyfileobj", refuse)
    full = "the disk of the temporary folder is full; free space, or set TMPDIR to another one."
    with pytest.raises(OutputError, match=full), unpacked(archive):
        pass


def test_names_in_utf8_that_do_not_say_so_are_read(tmp_path: Path) -> None:
    """As macOS writes them; others without that flag are in code page 437."""
    for encoding in ("utf-8", "cp437"):
        archive = tmp_path / f"{encoding}.zip"
        with zipfile.ZipFile(archive, "w") as packed:
            packed.writestr("0123456.json", "{}")
        archive.write_bytes(
            archive.read_bytes().replace(b"0123456.json", "Küche1.json".encode(encoding).rjust(12, b"-"))
        )
        with unpacked(archive) as folder:
            assert [path.name.lstrip("-") for path in folder.iterdir()] == ["Küche1.json"]


def test_cameras_beside_the_folder_of_the_photographs_are_named(tmp_path: Path) -> None:
    write_photographs(tmp_path / "scene" / "rgb", shots(2))
    (tmp_path / "scene" / "groundtruth.txt").write_text("# timestamp tx ty tz qx qy qz qw\n1 0 0 0 0 0 0 1\n")
    with unpacked(pack(tmp_path / "scene", tmp_path / "scan.zip", "scene/")) as folder:
        assert unread_cameras_notes(folder)[0].startswith("cameras in groundtruth.txt (TUM RGB-D) are not read")


@pytest.mark.parametrize("name", ["clip.MP4", "scan/inner.zip"])
def test_a_video_or_an_archive_in_an_archive_is_to_be_given_itself(name: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        packed.writestr(name, b"-")
        packed.writestr("README.txt", b"-")
    with pytest.raises(InputError) as refused, unpacked(tmp_path / "a.zip"):
        pass
    assert str(refused.value) == (
        f"{tmp_path / 'a.zip'}: the ZIP archive holds no photographs, but {name}; unpack it and give that file."
    )
