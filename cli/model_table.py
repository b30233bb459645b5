"""Number of parameters of each module, for `fecosplat info --parameters`."""

from fecocodec.sender.parameters import PUBLISHED, ParameterRow, parameter_table

from .output import print_columns, print_json


def print_parameters(profile: str, as_json: bool) -> None:
    """Print one row per module, then the totals that `decode` and `encode` load.

    For the profile `paper`, the totals of the paper's Table 1 are printed next to ours.
    """
    table = parameter_table(profile)
    published = PUBLISHED if profile == "paper" else {}
    if as_json:
        print_json([_fields(row, published) for row in table])
        return
    columns: list[tuple[str, ...]] = [
        ("module", "side", "parameters"),
        *((row.module, row.side, f"{row.parameters:,}") for row in table),
    ]
    if published:
        columns = [
            (*columns[0], "paper's Table 1"),
            *((*c, _beside(r)) for c, r in zip(columns[1:], table, strict=True)),
        ]
    print_columns(columns)


def _fields(row: ParameterRow, published: dict[str, float]) -> dict[str, object]:
    fields: dict[str, object] = {"module": row.module, "side": row.side, "parameters": row.parameters}
    return fields | {"published": published[row.module]} if row.module in published else fields


def _beside(row: ParameterRow) -> str:
    """Return the published number of parameters and the relative difference of ours, as text."""
    if row.module not in PUBLISHED:
        return ""
    published = PUBLISHED[row.module]
    return f"{published / 1e6:.2f} M ({100 * (row.parameters / published - 1):+.2f}%)"
