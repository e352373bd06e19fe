"""The option --version of both commands."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from microplan.schemas.page.console import say


class VersionOption(argparse.Action):
    """Prints the version and ends the call, as --help does.

    It is looked up where it is asked for: that takes a while.
    """

    def __init__(self, option_strings: list[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, **options)

    def __call__(
        self, parser: argparse.ArgumentParser, *_values: object, **_more: object
    ) -> NoReturn:
        """Print and exit with 0."""
        from importlib.metadata import version

        say(f"{parser.prog} {version('microplan')}")
        parser.exit()


def add_version(parser: argparse.ArgumentParser) -> None:
    """Add --version."""
    parser.add_argument(
        "--version",
        action=VersionOption,
        dest=argparse.SUPPRESS,
        default=argparse.SUPPRESS,
        help="print the version, and do nothing else",
    )
