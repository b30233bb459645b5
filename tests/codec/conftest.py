"""Choosing and reading photographs without encoding them."""

import pytest


@pytest.fixture
def uncoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """`encode_folder` returns no bytes, for tests of what would be encoded."""
    monkeypatch.setattr("fecocodec.codec.encode_views.encode", lambda _views, **_options: b"")
