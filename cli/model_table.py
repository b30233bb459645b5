"""Parameters of the networks by module and side, for `fecosplat info --model`."""

from fecocodec.sender.parameters import parameter_table

from .output import print_columns, print_json


def print_parameters(as_json: bool) -> None:
    """One row a module, then the sums: all that `decode` loads, and all that `encode` loads."""
    table = parameter_table()
    if as_json:
        print_json([{"module": row.module, "side": row.side, "parameters": row.parameters} for row in table])
    else:
        print_columns(
            [("module", "side", "parameters"), *((row.module, row.side, f"{row.parameters:,}") for row in table)]
        )
