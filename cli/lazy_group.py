"""A group of commands, which imports a command's module only when that command is run."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import click

from .common_options import add_common_options


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
