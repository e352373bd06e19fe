"""Completion for shells: what a script for one of them says of all commands."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from microplan.planner.cli.shipped import codes

FILES = ("task",)  # arguments that name files though they are kept as text
CODES = ("code",)  # arguments that name a finding's code: any case will do


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return a script that completes a command, made from its parser.

    Raises
    ------
    ImportError
        Without shtab, which is an extra: `microplan[completion]`.
    """
    import shtab

    for action in _actions(parser):
        if action.type is Path or action.dest in FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # shtab's way
        elif action.dest in CODES:
            action.choices = codes()  # of the script alone
    return shtab.complete(parser, shell)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its commands."""
    for action in parser._actions:  # noqa: SLF001 - argparse lists them nowhere else
        yield action
        if isinstance(action.choices, dict):  # name -> parser of a command
            for command in action.choices.values():
                yield from _actions(command)
