"""Subcommands that hand out what microplan ships: init, explain, schema."""

from __future__ import annotations

import argparse

from microplan.planner.cli.answering import BAD_INPUT, DONE
from microplan.planner.source.diagnostics import TITLES
from microplan.schemas.page.console import say, tell


def init(call: argparse.Namespace) -> int:
    """Write a task that compiles into a folder."""
    from microplan.planner.cli.starter import write_starter
    from microplan.planner.store.errors import OutputError

    try:
        say(write_starter(call.folder))
    except OutputError as error:
        tell(f"error[{error.code}]: {error}")
        return BAD_INPUT
    return DONE


def explain(call: argparse.Namespace) -> int:
    """Print the page of a code, or all codes."""
    from microplan.planner.cli.package_files import page

    if call.code is None:
        listed = (f"{code}  {title}" for code, title in TITLES.items())
        say("\n".join(listed))
        return DONE
    text = page(call.code)
    if text is None:
        tell(f"no code {call.code!r}; microplan explain lists all")
        return BAD_INPUT
    say(text.rstrip())
    return DONE


def schema(call: argparse.Namespace) -> int:
    """Print a JSON Schema."""
    import json

    from microplan.schemas.files.json_schema import load

    say(json.dumps(load(call.name), indent=2, ensure_ascii=False))
    return DONE
