"""Errors of the YAML parser in words: what was found, what is allowed."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import yaml

_SHOWN = 40  # characters of the file that a finding quotes
_QUOTES = "write the text in quotes"
_INDENT = "indent all keys of one mapping alike; one that holds others has no value"
_BRACKETS = {"mapping": ("{", "}"), "sequence": ("[", "]")}
_KINDS = {
    "-": "a list entry", "<block sequence start>": "a list entry",
    "?": "a key", "<block mapping start>": "a key",
}  # fmt: skip
_END = "<stream end>"


@dataclass(frozen=True, slots=True)
class YamlFault:
    """What is wrong, where it shows, and how to mend it."""

    mark: yaml.Mark | None  # None: of the whole file
    message: str
    hint: str = ""


@dataclass(frozen=True, slots=True)
class _ParserPlace:
    """Where the parser found an error, and the file's lines."""

    here: yaml.Mark  # where it shows
    began: yaml.Mark  # where that began which is at fault
    lines: Sequence[str]

    def line(self, mark: yaml.Mark) -> str:
        """Return the line of a mark, "" behind the last one."""
        return self.lines[mark.line] if mark.line < len(self.lines) else ""

    def rest(self, mark: yaml.Mark) -> str:
        """Return the text from a mark on, as findings quote it; no comments."""
        text = re.sub(r"\s#.*", "", self.line(mark)[mark.column :]).strip()
        return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def fault_of(error: yaml.MarkedYAMLError, lines: Sequence[str]) -> YamlFault:
    """Return an error of the parser's in our words; in its own where we have none."""
    words = " ".join(filter(None, (error.context, error.problem)))
    here = error.problem_mark
    if here is not None:
        place = _ParserPlace(here, error.context_mark or here, lines)
        for pattern, told in _RULES:
            found = re.search(pattern, words)
            if found:
                return told(place, found)
    return YamlFault(here or error.context_mark, words)


def _no_colon(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    """Return the fault of a line that is neither a key nor a value."""
    text = place.rest(place.began)
    key, colon, value = text.partition(":")
    if colon:
        message = f"'{text}' has no space after its colon"
        return YamlFault(place.began, message, f"write '{key}: {value}'")
    message = f"'{text}' has no colon: a line here is 'key: value'"
    hint = f"write '{text}: ...', or quote a text that takes several lines"
    return YamlFault(place.began, message, hint)


def _colon(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    """Return the fault of a colon where none is allowed."""
    before = place.line(place.here)[: place.here.column]
    if re.search(r":\s", before):
        message = "a second ': ' in one line"
        return YamlFault(place.here, message, "quote text that holds ': '")
    above = (line.strip() for line in reversed(place.lines[: place.here.line]))
    last = next((line for line in above if line and line[0] != "#"), "")
    if re.search(r":\S", last) and not re.search(r":(\s|$)", last):
        message = f"no space after the colon in the line above, '{last[:_SHOWN]}'"
        return YamlFault(place.here, message, "write 'key: value'")
    message = "a key under something that has a value already"
    return YamlFault(place.here, message, _INDENT)


def _odd_start(place: _ParserPlace, found: re.Match[str]) -> YamlFault:
    """Return the fault of a character that begins no value."""
    if found[1] == r"\t":
        return YamlFault(place.here, "a tab, where only spaces may stand", "use spaces")
    return YamlFault(place.here, f"text cannot begin with '{found[1]}'", _QUOTES)


def _open_quote(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    quote = place.rest(place.began)[:1]
    message = f"the quote {quote} that begins here is never closed"
    return YamlFault(place.began, message, f"close it with {quote}")


def _escape(place: _ParserPlace, found: re.Match[str]) -> YamlFault:
    what = f"'\\{found[1]}' means nothing" if found[1] else "a broken \\ sequence"
    message = f"{what} in double quotes"
    return YamlFault(place.here, message, "use single quotes, and / in paths")


def _reference(place: _ParserPlace, found: re.Match[str]) -> YamlFault:
    sign = {"alias": "*", "anchor": "&", "directive": "%", "tag": "!"}[found[1]]
    return YamlFault(place.began, f"text cannot begin with '{sign}'", _QUOTES)


def _entry(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    hint = "begin the list on a line of its own, or write [a, b]"
    return YamlFault(place.here, "a list entry '- ' behind something else", hint)


def _in_brackets(place: _ParserPlace, found: re.Match[str]) -> YamlFault:
    """Return the fault of a list or mapping in brackets that goes on as it may not."""
    opened, closed = _BRACKETS[found[1]]
    if found[2] == _END:
        message = f"the bracket {opened} that opens here is never closed"
        return YamlFault(place.began, message, f"close it with {closed}")
    behind = _behind_quote(place)
    if behind is not None:
        return behind
    colon = found[2] == ":"
    what = "this key" if colon else f"'{place.rest(place.here)}'"
    message = f"',' or '{closed}' must come before {what}, in the {opened} of line "
    hint = f"add the comma, or close it with {closed}"
    hint += ", or quote text that holds ': '" if colon else ""
    return YamlFault(place.here, f"{message}{place.began.line + 1}", hint)


def _in_block(place: _ParserPlace, found: re.Match[str]) -> YamlFault:
    """Return the fault of a line that does not continue the lines above it."""
    behind = _behind_quote(place)
    if behind is not None:
        return behind
    text = place.rest(place.here)
    if found[2] in "}]:":
        what = "has no key before it" if found[2] == ":" else "closes nothing"
        return YamlFault(place.here, f"'{found[2]}' {what}", "remove it")
    kind = _KINDS.get(found[2])
    if kind is None:
        return YamlFault(place.here, f"'{text}' stands behind a value", "remove it")
    if place.here.column != place.began.column:
        message = f"{kind} indented by {place.here.column}, as nothing above it is"
        return YamlFault(place.here, message, "indent what belongs together alike")
    among = "keys" if found[1] == "mapping" else "list entries"
    return YamlFault(
        place.here, f"{kind} among {among}", "put it under a key of its own"
    )


def _behind_quote(place: _ParserPlace) -> YamlFault | None:
    """Return the fault of text right behind a closing quote, as in "a".b."""
    column = place.here.column
    if place.line(place.here)[max(column - 1, 0) : column] not in ("'", '"'):
        return None
    text = re.match(r"[^\s,\]}]*", place.rest(place.here))
    message = f"'{text[0] if text else ''}' goes on behind the closing quote"
    hint = "quote all of it or nothing: a part.feature needs no quotes"
    return YamlFault(place.here, message, hint)


def _outside(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    message = f"'{place.rest(place.here)}' does not go on with what stands above it"
    return YamlFault(place.here, message, "begin all keys of a file in the same column")


def _no_value(place: _ParserPlace, found: re.Match[str]) -> YamlFault:
    message = f"'{found[1]}' where a value must stand"
    return YamlFault(place.here, message, "write the value, or remove the sign")


def _open_end(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    return YamlFault(place.here, "the file ends inside brackets", "close them")


def _folded(place: _ParserPlace, _found: re.Match[str]) -> YamlFault:
    sign = place.rest(place.began)[:1]
    message = f"'{sign}' begins a text of several lines, and stands alone"
    return YamlFault(place.began, message, f"{_QUOTES} if it begins with '{sign}'")


_Told = Callable[[_ParserPlace, re.Match[str]], YamlFault]
# the parser's words, context before problem, and what we say of it
_RULES: tuple[tuple[str, _Told], ...] = (
    (r"could not find expected ':'", _no_colon),
    (r"mapping values are not allowed here", _colon),
    (r"found character '(.+)' that cannot start any token", _odd_start),
    (r"scanning a quoted scalar found unexpected", _open_quote),
    (r"found unknown escape character ['\"](.+)['\"]", _escape),
    (r"expected escape sequence of \d+ hexadecimal numbers()", _escape),
    (r"(?:scanning|parsing) an? (alias|anchor|directive|tag) expected", _reference),
    (r"sequence entries are not allowed here", _entry),
    (r"a flow (mapping|sequence) expected .* but got '(.+)'", _in_brackets),
    (r"a block (mapping|collection) expected <block end>, but found '(.+)'", _in_block),
    (rf"expected '<document start>', but found '(?!{_END})", _outside),
    (r"expected the node content, but found '([^<].*)'", _no_value),
    (r"a flow node expected the node content, but found '<stream end>'", _open_end),
    (r"scanning a block scalar expected", _folded),
)
