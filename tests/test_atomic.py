"""Outputs appear whole or not at all."""

import errno
import os
import resource
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from fecocodec.atomic import require_writable, write_atomically
from fecocodec.errors import OutputError
from fecocodec.photographs.exr import write_exr


def test_the_file_appears_when_the_block_ends_with_usual_permissions(tmp_path):
    path = tmp_path / "out.png"
    with write_atomically(path, overwrite=False) as temporary:
        temporary.write_bytes(b"new")
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".png"
        assert not path.exists()
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]
    before = os.umask(0o027)
    try:
        with write_atomically(tmp_path / "out", overwrite=False) as temporary:
            temporary.write_bytes(b"")
    finally:
        os.umask(before)
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_any_failure_leaves_the_old_file_and_nothing_else(error, tmp_path):
    path = tmp_path / "out"
    path.write_bytes(b"old")
    with pytest.raises(error), write_atomically(path, overwrite=True) as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_existing_file_is_kept_unless_told_otherwise(tmp_path):
    path = tmp_path / "out"
    path.write_bytes(b"old")
    with pytest.raises(OutputError) as caught, write_atomically(path, overwrite=False):
        pytest.fail("the block must not be entered")
    assert str(caught.value) == (
        f"{path}: the file exists already; choose another output path or replace it by `overwrite`."
    )
    with write_atomically(path, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
    assert path.read_bytes() == b"new"


def test_a_symbolic_link_survives(tmp_path):
    (tmp_path / "target").write_bytes(b"old")
    link = tmp_path / "link"
    link.symlink_to("target")
    with write_atomically(link, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
    assert link.is_symlink()
    assert (tmp_path / "target").read_bytes() == b"new"


def test_paths_that_cannot_hold_a_file(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_bytes(b"")
    link.symlink_to("nothing")
    for place in (file, link):
        for path in (place / "out", place / "new" / "out"):
            with pytest.raises(OutputError) as caught:
                require_writable(path, overwrite=True)
            assert str(caught.value) == f"{path}: {place} is not a folder; choose another output path."
    for place in (tmp_path, tmp_path / "fifo"):
        if place != tmp_path:
            os.mkfifo(place)
        with pytest.raises(OutputError) as caught:
            require_writable(place, overwrite=True)
        reason = "this exists and is not a plain file; choose another output path."
        if place == tmp_path:
            reason = f"this is a folder; give the name of a file, such as {tmp_path / 'NAME'}."
        assert str(caught.value) == f"{place}: {reason}"


def test_missing_folders_are_made_and_go_again_if_the_block_fails(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path("new") / "folder" / "out"
    require_writable(path, overwrite=False)
    with pytest.raises(ValueError, match="stop"), write_atomically(path, overwrite=False) as temporary:
        temporary.write_bytes(b"half")
        raise ValueError("stop")
    assert not list(tmp_path.iterdir())
    with write_atomically(path, overwrite=False) as temporary:
        temporary.write_bytes(b"whole")
    assert path.read_bytes() == b"whole"


@contextmanager
def nearly_full_disk():
    """A limit on the size of files, which the system reports the way it reports a full disk: part-way through.

    Not a fixture: while it holds, pytest could not write its own report to a file.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_write_that_the_system_refuses(tmp_path):
    path = tmp_path / "out"
    with (
        nearly_full_disk(),
        pytest.raises(OutputError) as caught,
        write_atomically(path, overwrite=False) as temporary,
    ):
        temporary.write_bytes(bytes(5000))
    assert str(caught.value) == (
        f"{path}: writing failed (File too large); check free space and permissions or choose another output path."
    )
    assert not list(tmp_path.iterdir())


def test_a_write_that_fails_inside_openexr(tmp_path):
    with nearly_full_disk(), pytest.raises(OutputError, match="writing failed"):
        write_exr(tmp_path / "out.exr", torch.rand(3, 64, 64))
    assert not list(tmp_path.iterdir())


def test_a_folder_without_permission():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o555)
        with (
            _without_privileges(),
            pytest.raises(OutputError, match="Permission denied"),
            write_atomically(folder / "out", overwrite=False) as temporary,
        ):
            temporary.write_bytes(b"")
        assert not list(folder.iterdir())


@contextmanager
def _without_privileges():
    """The superuser may write everywhere, so it becomes "nobody" for a while; others stay who they are."""
    user = os.geteuid()
    if user != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


def test_a_disk_that_refuses_even_to_tidy_up(tmp_path, monkeypatch):
    def refuse(*_arguments, **_options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr("pathlib.Path.write_bytes", refuse)
    monkeypatch.setattr("pathlib.Path.unlink", refuse)
    with (
        pytest.raises(OutputError, match=r"writing failed \(Read-only file system\)"),
        write_atomically(tmp_path / "out", overwrite=False) as temporary,
    ):
        temporary.write_bytes(b"")


def assert_theirs_is_kept(path):
    with (
        pytest.raises(OutputError, match="the file exists already"),
        write_atomically(path, overwrite=False) as temporary,
    ):
        temporary.write_bytes(b"mine")
        path.write_bytes(b"theirs")
    assert path.read_bytes() == b"theirs"


def test_a_file_that_appears_meanwhile_is_kept(tmp_path):
    path = tmp_path / "out"
    assert_theirs_is_kept(path)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("number", [errno.EPERM, errno.ENOTSUP])
def test_file_systems_without_hard_links(number, tmp_path, monkeypatch):
    def refuse(*_arguments):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fecocodec.atomic.os.link", refuse)
    path = tmp_path / "out"
    with write_atomically(path, overwrite=False) as temporary:
        temporary.write_bytes(b"mine")
    assert path.read_bytes() == b"mine"
    path.unlink()
    assert_theirs_is_kept(path)


@pytest.mark.parametrize("overwrite", [True, False])
def test_names_that_no_file_can_have(overwrite, tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    for path, reason in (
        (tmp_path / ("a" * 300), "File name too long"),
        (loop, "Too many levels of symbolic links"),
        (loop / "out", "Too many levels of symbolic links"),
        (tmp_path / "a\0b", "embedded null byte"),
    ):
        with pytest.raises(OutputError) as caught:
            require_writable(path, overwrite=overwrite)
        refused = path.parent if path.parent == loop else path
        assert str(caught.value) == f"{refused}: cannot be written ({reason}); choose another output path."


def test_folders_that_take_no_new_file_are_found_before_any_work():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o555)
        for path in (folder / "out", folder / "missing" / "out"):
            with _without_privileges(), pytest.raises(OutputError) as caught:
                require_writable(path, overwrite=False)
            assert str(caught.value) == (
                f"{path}: no file can be made in {folder} (Permission denied); choose another output path."
            )
        folder.chmod(0o755)
        require_writable(folder / "missing" / "out", overwrite=False)
        assert not list(folder.iterdir())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "closed"
        folder.mkdir(mode=0o000)
        with _without_privileges(), pytest.raises(OutputError, match=r"cannot be written \(Permission denied\)"):
            require_writable(folder / "out", overwrite=False)
