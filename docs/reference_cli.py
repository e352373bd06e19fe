"""Tables of a program's options, from its argument parser."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator

from reference_keys import row

HEADS = ("argument", "values", "default", "meaning")
COMMON = ("verbose", "format")  # of several commands: said once


def program(parser: argparse.ArgumentParser) -> str:
    """Return the chapters of a program: itself, then each of its commands."""
    blocks = [f"## `{parser.prog}`\n\n{parser.description}"]
    commands = list(_commands(parser))
    if commands:
        lines = [f"- [`{command.prog}`](#{_anchor(command.prog)})"
                 for command, _ in commands]  # fmt: skip
        blocks.append("\n".join(lines))
        shared = {a.dest: a for c, _ in reversed(commands) for a in _actions(c)}
        blocks += ["Commands with findings take"]
        blocks += [_table([shared[name] for name in COMMON])]
        for command, says in commands:
            blocks.append(
                f"### `{command.prog}`\n\n{_upper(says)}.\n\n{_call(command)}"
            )
            said = {shared[name].help for name in COMMON}
            blocks.append(_table(a for a in _actions(command) if a.help not in said))
    else:
        blocks += [_call(parser), _table(_actions(parser))]
    if parser.epilog:
        blocks.append(parser.epilog)
    return "\n\n".join(blocks)


def _commands(
    parser: argparse.ArgumentParser,
) -> Iterator[tuple[argparse.ArgumentParser, str]]:
    """Yield the commands of a program with what they do."""
    for action in _actions(parser):
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - see `_actions`
            says = {choice.dest: choice.help for choice in _choices(action)}
            for name, command in action.choices.items():
                yield command, says.get(name) or ""


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return a parser's arguments, for which argparse has no public name."""
    return [a for a in parser._actions if a.dest != "help"]  # noqa: SLF001


def _choices(action: argparse.Action) -> list[argparse.Action]:
    """Return the commands of a parser as its help lists them."""
    return list(action._get_subactions())  # type: ignore[attr-defined] # noqa: SLF001


def _call(parser: argparse.ArgumentParser) -> str:
    """Return how a command is called."""
    words = [parser.prog]
    actions = _actions(parser)
    for action in actions:
        if action.option_strings and action.required:
            words.append(f"{action.option_strings[-1]} {_value(action)}")
    words += ["[OPTIONS]"] * any(a.option_strings for a in actions)
    for action in actions:
        if not action.option_strings:
            name = action.dest.upper()
            words.append(f"[{name}]" if action.nargs == "?" else name)
    return f"    {' '.join(words)}"


def _table(actions: Iterable[argparse.Action]) -> str:
    """Return the table of arguments."""
    lines = [row(HEADS), "|" + "---|" * len(HEADS)]
    for action in sorted(actions, key=lambda a: bool(a.option_strings)):
        if action.help == argparse.SUPPRESS:
            continue
        name = ", ".join(action.option_strings) or action.dest.upper()
        lines.append(
            row([f"`{name}`", _values(action), _default(action), _help(action)])
        )
    return "\n".join(lines)


def _values(action: argparse.Action) -> str:
    """Return what may stand after an argument."""
    if action.choices is not None:
        return ", ".join(f"`{choice}`" for choice in action.choices)
    if action.nargs == 0:
        return "a switch"
    many = " ..." if action.nargs in ("+", "*") else ""
    return (_value(action) if action.option_strings else "") + many


def _value(action: argparse.Action) -> str:
    """Return the word that stands for an option's value."""
    return str(action.metavar or action.dest.upper())


def _default(action: argparse.Action) -> str:
    """Return what counts if an argument is left out."""
    if action.required:
        return "needed"
    if action.nargs == 0 or action.default in (None, "", [], ()):
        return ""
    return f"`{action.default}`"


def _help(action: argparse.Action) -> str:
    """Return what an argument is for; several may be given where that is so."""
    text = (action.help or "").replace("%%", "%")
    repeated = isinstance(action, argparse._AppendAction)  # noqa: SLF001
    more = "; may be given several times"
    return text + (more if repeated and more not in text else "")


def _anchor(text: str) -> str:
    """Return the anchor of a heading."""
    return text.replace(" ", "-")


def _upper(text: str) -> str:
    """Return a sentence with a capital."""
    return text[:1].upper() + text[1:]
