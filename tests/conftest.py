"""Tests run with every annotated shape and type of the library checked at each call."""

from jaxtyping import install_import_hook

install_import_hook("fecocodec", "beartype.beartype")
