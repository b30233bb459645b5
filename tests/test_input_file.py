"""Reading files of others: regular files only."""

import os
from pathlib import Path

import pytest

from fecocodec.errors import InputError
from fecocodec.input_file import read_file, read_json


def test_a_regular_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json(tmp_path / "a.json") == {"a": 1}


def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="a pipe or a device cannot be read here; give a regular file"):
            read_file(path)
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory\); check the path"):
        read_file(tmp_path)
    with pytest.raises(InputError, match=r"no file can have such a name .*null byte"):
        read_file(tmp_path / "a\0b")
