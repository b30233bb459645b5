"""The specification's own programs, imported as they stand: they are no package and know nothing of one."""

import sys
from pathlib import Path

SPECIFICATION = Path(__file__).resolve().parents[2] / "bitstream_spec"
READER = SPECIFICATION / "read_stream.py"
SYMBOL_READER = SPECIFICATION / "read_symbols.py"
RECEIVER = SPECIFICATION / "read_gaussians.py"

sys.path.insert(0, str(SPECIFICATION))
import read_gaussians  # noqa: E402
import read_stream  # noqa: E402
import read_symbols  # noqa: E402

sys.path.remove(str(SPECIFICATION))

__all__ = ["READER", "RECEIVER", "SPECIFICATION", "SYMBOL_READER", "read_gaussians", "read_stream", "read_symbols"]
