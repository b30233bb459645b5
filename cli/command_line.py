"""The group of all commands, which imports a command's module only when it runs, and the options of every command."""

import tomllib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from fecocodec import __version__
from fecocodec.errors import InputError
from fecocodec.input_file import read_text

from .main import COMMANDS
from .options import FILE_PATH
from .output import Verbosity, set_verbosity

_REMEDY = "correct the file"
_FILE = "fecosplat.config_file"  # key of `Context.meta`


def add_common_options(command: click.Command) -> None:
    """Add the options to a command that does not have them yet."""
    known = {parameter.name for parameter in command.params}
    command.params.extend(option for option in _options() if option.name not in known)


def _options() -> tuple[click.Option, ...]:
    return (
        click.Option(
            ["-q", "--quiet"],
            is_flag=True,
            expose_value=False,
            callback=_set_verbosity,
            help="Print only warnings and errors on stderr.",
        ),
        click.Option(
            ["-v", "--verbose"],
            is_flag=True,
            expose_value=False,
            callback=_set_verbosity,
            help="Print each step with its time on stderr.",
        ),
        click.Option(
            ["--config-file"],
            type=FILE_PATH,
            metavar="FILE.toml",
            is_eager=True,
            expose_value=False,
            callback=_set_defaults,
            help="Read default values of options from this file.",
        ),
    )


def _set_verbosity(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        set_verbosity(ctx, Verbosity[str(param.name).upper()])


def _set_defaults(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    """Make the values of the file the defaults of the command of `ctx`.

    Raises InputError if the file is not valid TOML, or names a command or an option that does not exist.
    """
    if value is not None:
        ctx.default_map, ctx.meta[_FILE] = _read_defaults(value, ctx), value


class LazyGroup(click.Group):
    """Click group with lazy subcommands: the libraries of one command do not slow down the start of another.

    modules: the module of each command, which defines it as `command`.
    """

    def __init__(self, *arguments: Any, modules: Mapping[str, str], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.modules = modules

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.modules)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.modules:
            return None
        command: click.Command = import_module(f".{self.modules[cmd_name]}", __package__).command
        if not isinstance(command, click.Group):
            add_common_options(command)
        return command


@click.group(
    cls=LazyGroup,
    modules={name: name for name in COMMANDS},
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True},
    epilog="Run `fecosplat COMMAND --help` for the options of a command and examples.",
)
@click.version_option(__version__, prog_name="fecosplat", message="%(prog)s %(version)s")
def command_line() -> None:
    """Compress photographs of a scene to a small .fcs file, and decode that file to 3D Gaussians.

    \b
      fecosplat encode photos/ -o scene.fcs     photographs, cameras given or estimated -> some kilobytes
      fecosplat decode scene.fcs -o scene.ply   the file -> 3D Gaussians for any 3DGS viewer
    """


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
