"""Kit's `omni.kit.commands`: actions that are executed by name and can be undone.

    ok, identifier = omni.kit.commands.execute("CreateSublayer", layer_identifier=root, ...)
    omni.kit.undo.undo()

Each context has its own history, which ends with its stage. In a live project the edits of a command are one
transaction, and undo changes only one's own work (see RecordedCommand).
"""

from __future__ import annotations

import importlib
import inspect
import types
import typing

from pxr import Usd

from usdlive.omni.usd import UsdContext

from . import _history
from ._command import Command, CommandFailed, RecordedCommand, context_of
from ._history import UndoResult

__all__ = [
    "Command", "CommandFailed", "RecordedCommand", "UndoResult", "create", "execute", "execute_command",
    "get_command_class", "get_commands", "register", "register_all_commands_in_module", "unregister",
    "unregister_module_commands",
]

# Kit's API finds commands by name, so there is a registry here.
_commands: dict[str, type[Command]] = {}
# Modules with our own commands. They are imported when a name is unknown.
_OUR_MODULES = ["usdlive.omni.usd.commands", "usdlive.omni.kit.usd.layers.commands"]
_CONTEXT_ARGUMENTS = ("usd_context", "usd_context_name", "context_name", "stage_or_context")


def _short(name: str) -> str:
    return name.removesuffix("Command")


def register(command_class: type[Command]) -> None:
    """Registers a command. Any class with do() is accepted."""
    if not callable(getattr(command_class, "do", None)):
        raise TypeError(f"{command_class.__name__} has no do()")
    _commands[_short(command_class.__name__)] = command_class


def unregister(command_class: type[Command]) -> None:
    _commands.pop(_short(command_class.__name__), None)


def register_all_commands_in_module(module: types.ModuleType | str) -> list[type[Command]]:
    """Registers every Command that the module defines. Returns them for unregister_module_commands()."""
    if isinstance(module, str):
        module = importlib.import_module(module)
    found = [member for _, member in inspect.getmembers(module, inspect.isclass)
             if member.__module__ == module.__name__ and issubclass(member, Command)
             and not inspect.isabstract(member)]
    for command_class in found:
        register(command_class)
    return found


def unregister_module_commands(command_classes: typing.Iterable[type[Command]]) -> None:
    for command_class in command_classes:
        unregister(command_class)


def get_command_class(name: str) -> type[Command] | None:
    while _short(name) not in _commands and _OUR_MODULES:
        register_all_commands_in_module(_OUR_MODULES.pop(0))
    return _commands.get(_short(name))


def get_commands() -> dict[str, type[Command]]:
    while _OUR_MODULES:
        register_all_commands_in_module(_OUR_MODULES.pop(0))
    return dict(_commands)


def create(name: str, **kwargs: typing.Any) -> Command:
    """Creates a command without executing it. Raises CommandFailed if the name is unknown or the arguments do
    not match."""
    command_class = get_command_class(name)
    if command_class is None:
        raise CommandFailed("there is no such command")
    try:
        inspect.signature(command_class).bind(**kwargs)
    except TypeError as error:
        raise CommandFailed(str(error)) from error
    return command_class(**kwargs)


def execute(name: str, **kwargs: typing.Any) -> tuple[bool, typing.Any]:
    """Executes a command. Returns (True, the result of do()). On failure returns (False, None), logs the
    reason, and undoes everything."""
    try:
        command = create(name, **kwargs)
    except Exception as error:  # Kit's execute does not raise
        _history.log_failure(name, error)
        return False, None
    return execute_command(command, name, kwargs)


def execute_command(command: Command, name: str | None = None,
                    kwargs: dict[str, typing.Any] | None = None) -> tuple[bool, typing.Any]:
    name, kwargs = name or _short(type(command).__name__), kwargs or {}
    try:
        return True, _history.history_of(_context(kwargs)).run(_history.Entry(name, command, kwargs))
    except Exception as error:  # noqa: BLE001
        _history.log_failure(name, error)
        return False, None


def _context(kwargs: dict[str, typing.Any]) -> UsdContext | None:
    for argument in _CONTEXT_ARGUMENTS:
        if isinstance(given := kwargs.get(argument), (str, UsdContext, Usd.Stage)):
            return context_of(given)
    return context_of("")
