"""Console output of both commands, for any terminal, pipe or full disk."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable
from typing import Any, NoReturn, TextIO


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


# all control characters but tabs and line ends, those that turn text round, and those
# that nobody sees
_CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e"
    r"\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb]"
)

_LINE_END = re.compile(r"[\n\r\x85\u2028\u2029]")


class OutputLostError(Exception):
    """Results that standard output did not take; the message says why."""


def say(text: str) -> None:
    """Print results on standard output.

    A reader that has left, as `head` does, is no fault: the rest is not wanted.

    Raises
    ------
    OutputLostError
        If they cannot be written otherwise, to a disk that is full for one.
    """
    error = _print(text, sys.stdout)
    if error is not None:
        raise OutputLostError(f"standard output: {error.strerror or error}")


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether a terminal reads a standard stream, which may be closed."""
    try:
        return stream is not None and stream.isatty()
    except (OSError, ValueError):  # closed since, or its descriptor is
        return False


def one_line(text: str) -> str:
    """Return text in which line ends are spelled out: a name cannot begin a line."""
    return _LINE_END.sub(_spelled, text)


def tell(text: str, paint: Callable[[str], str] | None = None) -> None:
    """Print findings or progress on standard error, if anybody takes them.

    `paint` may add what a terminal obeys, once the text itself holds none of it.
    """
    _print(text, sys.stderr, paint)


def redraw(line: str, width: int) -> None:
    """Print progress in place on standard error: over the line before, no line end."""
    _print(line.ljust(width), sys.stderr, lambda text: f"\r{text}\r", end="")


def flush() -> None:
    """Have on standard output what others wrote there; raises as `say`."""
    say("")


def _print(
    text: str,
    stream: TextIO | None,
    paint: Callable[[str], str] | None = None,
    end: str = "\n",
) -> OSError | None:
    """Print text, if any, and return what lost it.

    Names in files may hold what a terminal obeys, or what its encoding does not have.
    """
    if stream is None or stream.closed:  # None: before the process began
        return None
    text = _CONTROL.sub(_spelled, text)
    encoding = stream.encoding or "utf-8"
    text = text.encode(encoding, "backslashreplace").decode(encoding)
    text = paint(text) if paint else text
    try:
        print(text, end=end if text else "", file=stream, flush=True)
    except OSError as error:
        _leave(stream)
        return None if isinstance(error, BrokenPipeError) else error
    return None


def _spelled(found: re.Match[str]) -> str:
    return f"\\u{ord(found[0]):04x}"


def _leave(stream: TextIO) -> None:
    """Send nowhere what is left: the interpreter would flush it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
