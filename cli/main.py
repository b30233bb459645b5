"""Entry point: run one command, and report every expected error as one sentence and an exit code.

Exit codes: 0 success; 1 the input or output cannot be used; 2 wrong usage; 3 only part of a damaged file could be
decoded (`decode --partial`); 128 + N terminated by signal N (130 for Ctrl-C).
"""

import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from fecocodec.errors import installation

from .process import EndingSignals, prepare_process, prepare_streams

COMMANDS = ("encode", "decode", "info", "render", "view", "web", "train", "eval", "stress", "batch", "doctor")
INTERRUPTED = 130
# Libraries of the extra `sender`, by the names under which they are imported.
SENDER_LIBRARIES = ("torch", "numba", "scipy", "PIL", "OpenEXR", "safetensors", "onnx", "onnxscript")


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code. arguments: None for those of the process (`sys.argv`)."""
    import click

    from fecocodec import FecoError

    from .command_line import command_line, with_file
    from .output import in_options, warn

    try:
        code = command_line.main(arguments, prog_name="fecosplat", standalone_mode=False)
    except ModuleNotFoundError as error:
        warn(missing_module(error))
        return 1
    except FecoError as error:
        warn(f"fecosplat: {in_options(str(error))}")
        return 1
    except click.ClickException as error:
        with_file(error).show()
        return error.exit_code
    except FileNotFoundError:
        if has_working_folder():
            raise
        warn("fecosplat: the working folder was removed; change to another one by `cd`.")
        return 1
    except click.Abort:
        warn("fecosplat: interrupted")
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def has_working_folder() -> bool:
    """Return whether the folder in which the process runs still exists."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def missing_module(error: ModuleNotFoundError) -> str:
    """Return the message for a library that the receiver alone does not install. Raises the error for any other."""
    library = (error.name or "").partition(".")[0]
    if library not in SENDER_LIBRARIES:
        raise error
    return (
        f"fecosplat: this needs {library}, which is not installed; run {installation('sender')} (README.md, Install, "
        "has the line for machines without a GPU)."
    )


def main() -> NoReturn:
    """Run the console script. Signal handlers are installed before any large import."""
    prepare_streams()
    with EndingSignals() as signals:
        try:
            prepare_process()
            code = run()
        except BaseException:
            if signals.received is None:
                raise
    if signals.received is None:
        sys.exit(code)
    sys.stderr.write(f"fecosplat: {signals.description}\n")
    sys.exit(128 + signals.received)
