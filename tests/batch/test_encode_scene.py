"""What of the work of `batch encode` changes files, and what is refused before any of it."""

import pytest

from fecocodec.batch.encode_scene import EncodeScene
from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import InputError


def test_sharpness_is_an_option_of_a_file_only_where_it_is_given() -> None:
    plain, sharp = EncodeScene(), EncodeScene(EncodingOptions(sharpness=0.5))
    assert "sharpness" not in plain.options()  # files that were encoded before there was one stay valid
    assert sharp.options() == plain.options() | {"sharpness": 0.5}


def test_a_sharpness_without_steps_is_refused() -> None:
    with pytest.raises(InputError, match="needs the steps"):
        EncodeScene(EncodingOptions(effort="fast", sharpness=0.5))
