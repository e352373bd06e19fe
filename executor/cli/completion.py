"""Completion for shells: an option that prints a script for one of them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SHELLS = ("bash", "zsh", "fish")
FILES = ("station",)  # arguments that name files though they are kept as text


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


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return a script that completes a command, made from its parser.

    Raises
    ------
    ImportError
        Without shtab, which is an extra: `microplan[completion]`.
    """
    import shtab

    for action in parser._actions:  # noqa: SLF001 - argparse lists them nowhere else
        if action.type is Path or action.dest in FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # shtab's way
    return shtab.complete(parser, shell)
