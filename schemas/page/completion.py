"""Completion scripts for shells, made from the arguments of a command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

SHELLS = ("bash", "zsh", "fish")
FILES = ("task", "station")  # arguments that name files though they are kept as text


class Completion(argparse.Action):
    """Prints the script that completes a command and ends the call, as --help does."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Print and exit: 0, or 2 without shtab."""
        del namespace, option_string
        try:
            sys.stdout.write(script(parser, str(values)))
        except ImportError:
            parser.error("--completion needs shtab: install microplan[completion]")
        parser.exit()


def script(
    parser: argparse.ArgumentParser,
    shell: str,
    choices: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> str:
    """Return a script that completes a command, made from its parser.

    `choices` are what the script alone offers for arguments by name.

    Raises
    ------
    ImportError
        Without shtab, which is an extra: `microplan[completion]`.
    """
    import shtab

    for action in _actions(parser):
        if action.type is Path or action.dest in FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # shtab's way
        elif action.dest in choices:
            action.choices = choices[action.dest]
    return shtab.complete(parser, shell)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its commands."""
    for action in parser._actions:  # noqa: SLF001 - argparse lists them nowhere else
        yield action
        if isinstance(action.choices, dict):  # name -> parser of a command
            for command in action.choices.values():
                yield from _actions(command)
