"""Default values of options from a TOML file, one table per command: `[encode]`, `[batch.encode]`."""

import tomllib
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from fecocodec.errors import InputError
from fecocodec.input_file import read_text

from .main import COMMANDS

_REMEDY = "correct the file"
_FILE = "fecosplat.config_file"  # key of `Context.meta`


def set_defaults(path: Path, ctx: click.Context) -> None:
    """Make the values of the file the defaults of the command of `ctx`.

    Raises InputError if the file is not valid TOML, or names a command or an option that does not exist.
    """
    ctx.default_map, ctx.meta[_FILE] = _read_defaults(path, ctx), path


def with_file(error: click.ClickException) -> click.ClickException:
    """Return the error; if the value that was refused comes from the file, its message names the file."""
    if not isinstance(error, click.BadParameter) or error.ctx is None or error.param is None:
        return error
    if error.ctx.get_parameter_source(str(error.param.name)) is not ParameterSource.DEFAULT_MAP:
        return error
    message = f"{error.message.removesuffix('.')}; the value is in {error.ctx.meta[_FILE]}."
    return click.BadParameter(message, error.ctx, error.param, error.param_hint)


def _read_defaults(path: Path, ctx: click.Context) -> dict[str, Any]:
    """Return the values for the command of `ctx` by parameter name. Tables of other commands are not used."""
    try:
        content = tomllib.loads(read_text(path, _REMEDY))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: broken TOML ({error}); {_REMEDY}.") from error
    for name in content:
        if name not in COMMANDS:
            raise InputError(f"{path}: there is no command '{name}'; give each table the name of a command.")
    names = _command_names(ctx)
    table: Any = content
    for name in names:
        table = table.get(name, {}) if isinstance(table, dict) else table
    if not isinstance(table, dict):
        raise InputError(f"{path}: '{names[0]}' is not a table; write options below [{'.'.join(names)}].")
    place = f"{path}, table [{'.'.join(names)}]"
    options = _options_by_key(ctx.command)
    verbs = getattr(ctx.command, "verbs", ())  # have tables of their own
    return dict(_default(place, key, value, options) for key, value in table.items() if key not in verbs)


def _command_names(ctx: click.Context) -> list[str]:
    """Return the names of a command below the program: ["batch", "encode"]."""
    if ctx.parent is None:
        return []
    return [*_command_names(ctx.parent), *str(ctx.info_name).split()]  # "train steps": a verb


def _options_by_key(command: click.Command) -> dict[str, click.Option]:
    options = [parameter for parameter in command.params if isinstance(parameter, click.Option)]
    return {name.removeprefix("--"): option for option in options for name in option.opts if name.startswith("--")}


def _default(place: str, key: str, value: Any, options: dict[str, click.Option]) -> tuple[str, Any]:
    """Return the parameter name and the value of one line."""
    if key not in options or key == "config-file":
        raise InputError(f"{place}: there is no option '{key}'; the command lists its options with --help.")
    option = options[key]
    is_list = option.multiple or option.nargs != 1
    values = value if is_list and isinstance(value, list) else [value]
    if not values or not all(isinstance(item, str | int | float) for item in values):
        raise InputError(f"{place}: the value of '{key}' is no text, number or boolean; {_REMEDY}.")
    texts = [item if isinstance(item, bool) else str(item) for item in values]  # parsed as on the command line
    assert option.name is not None
    return option.name, texts if is_list else texts[0]
