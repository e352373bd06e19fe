"""Findings: where in the user's files, what, and how to mend it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from typing import Literal

# every code and what it says in a few words; each has a page in docs/diagnostics/,
# none is used again for something else
TITLES: Mapping[str, str] = {
    "MP001": "file cannot be read",
    "MP002": "file is not UTF-8 text",
    "MP003": "file is not valid YAML",
    "MP004": "key given twice",
    "MP005": "anchor or alias",
    "MP006": "tag",
    "MP007": "several documents in one file",
    "MP008": "number is not finite",
    "MP009": "file is too large or too deep",
    "MP010": "path leads out of the folder",
    "MP011": "file is empty",
    "MP012": "key is not text",
    "MP013": "format is of another version",
    "MP101": "value of the wrong type",
    "MP102": "key is missing",
    "MP103": "number out of range",
    "MP104": "unknown key",
    "MP105": "value is not one of those allowed",
    "MP106": "wrong number of entries",
    "MP107": "text of the wrong form",
    "MP109": "key means nothing here",
    "MP110": "name leads nowhere",
    "MP111": "step id given twice",
    "MP112": "name of the wrong kind of thing",
    "MP113": "interval runs backwards",
    "MP115": "start pose is missing",
    "MP116": "values contradict each other",
    "MP117": "name stands for two things",
    "MP118": "reading beyond the limits",
    "MP119": "light lacks a number",
    "MP120": "coherence of 0",
    "MP201": "not a readable DXF file",
    "MP202": "drawing is damaged",
    "MP203": "entity cannot be read",
    "MP204": "layer holds nothing",
    "MP205": "outline is open",
    "MP208": "outline crosses itself",
    "MP209": "several outlines for one part",
    "MP210": "drawing names other units",
    "MP211": "small gaps were closed",
    "MP212": "more than two edges meet",
    "MP213": "drawn twice",
    "MP214": "entity is no plane outline",
    "MP215": "too many entities",
    "MP216": "drawing has an absurd size",
    "MP217": "block holds itself",
    "MP218": "coarse coordinates",
    "MP219": "left out of a drawing",
    "MP220": "drawn in the paper space alone",
    "MP221": "feature is not in the drawing",
    "MP222": "drawing has another number of teeth",
    "MP223": "tool drawing does not fit the tool",
    "MP224": "lines with a width",
    "MP225": "curves became arcs",
    "MP226": "second reader disagrees",
    "MP227": "no second reading",
    "MP228": "several rings could be meant",
    "MP229": "mark is not on its face",
    "MP230": "not a readable GDSII file",
    "MP231": "not clear which cell",
    "MP232": "cells do not make a drawing",
    "MP233": "shape has no exact reading",
    "MP234": "format that is not read",
    "MP235": "polygons taken for circles",
    "MP236": "labels passed over",
    "MP301": "step order cannot happen",
    "MP302": "not located yet",
    "MP303": "motion would touch something",
    "MP304": "part does not fit between the jaws",
    "MP305": "jaws do not reach the part",
    "MP306": "target is hidden or shaded",
    "MP307": "key has no effect",
    "MP308": "part hangs over what it is put on",
    "MP309": "a start is exactly known",
    "MP310": "jaws may turn a part either way",
    "MP401": "target does not stay inside the field",
    "MP402": "focus out of reach",
    "MP403": "feature too fine for the pixels",
    "MP404": "nothing to render",
    "MP405": "look made in two",
    "MP406": "few magnifications show a target",
    "MP407": "something opaque under the target",
    "MP501": "no routine is good enough",
    "MP502": "no routine for this target",
    "MP503": "what errors of a look's images cost",
    "MP504": "how far real pictures move a look",
    "MP601": "hole and shaft do not fit",
    "MP602": "success below the goal",
    "MP603": "tolerance finer than the stage can meet",
    "MP605": "no hole over a post",
    "MP610": "how hole and shaft fit",
    "MP611": "shaft may wedge",
    "MP612": "how an alignment is run",
    "MP613": "whether a released part stays",
    "MP614": "how firmly a part is held",
    "MP615": "where a placed part comes to lie",
    "MP616": "success not shown at the confidence asked for",
    "MP617": "outlines overlap",
    "MP618": "angle of a fit not aligned",
    "MP619": "fit of more than one ring",
    "MP701": "not a plan folder",
    "MP702": "output cannot be written",
    "MP703": "file is there already",
    "MP704": "plan cannot be read",
    "MP710": "plans differ",
    "MP720": "nothing to export",
    "MP721": "plan folder is not whole",
    "MP722": "exported plan is infeasible",
    "MP730": "sweep cannot be made",
    "MP731": "scheduler or its workers do not fit",
    "MP901": "a picture cannot be used",
    "MP902": "nothing measures this target",
    "MP903": "what is to be measured is not clear",
    "MP904": "pictures do not tell this of the camera",
    "MP905": "readings of pictures are not clear",
}

IN_TURN = frozenset({"MP710"})  # ordered by what they are about, causes first
MOST_ALIKE = 100  # findings of one code that are listed; the rest is counted
# characters of a message or hint: names in files may be of any length
MOST_WORDS = 1000
EXCERPT = 120  # characters of a source line that are shown around the caret

# infeasible, different: understood, but the answer is no (exit status 1)
Severity = Literal["error", "infeasible", "different", "warning", "note"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A position in a file; line and column count from 1, line 0 is the whole file."""

    file: str  # as the user named it
    line: int = 0
    column: int = 0
    length: int = 1
    text: str = ""  # the source line, for the caret


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """One finding, placed in the user's file."""

    code: str  # "MP301"; has a page in docs/diagnostics/, never reused
    severity: Severity
    where: Span
    message: str  # the value, the limit, the unit
    hint: str = ""  # how to mend it
    action: bool = True  # False: a fact, for which nothing needs to be done


class CallError(Exception):
    """Why a command cannot do what it was called for; carries the finding's code."""

    def __init__(
        self, code: str, message: str, file: str | PathLike[str] = "", hint: str = ""
    ) -> None:
        super().__init__(message)
        # "" for the file: what cannot be done is said of the task
        self.code, self.file, self.hint = code, fspath(file), hint


@dataclass(slots=True)
class Report:
    """Collects the findings of one compile: the only state that stages share."""

    found: list[Diagnostic] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)  # path read -> its sha256
    sought: set[str] = field(default_factory=set)  # paths, read or not

    def error(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something that makes the input unusable (exit status 2)."""
        self._add("error", code, where, message, hint)

    def refuse(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add a reason why the task, though understood, cannot be done (status 1)."""
        self._add("infeasible", code, where, message, hint)

    def differ(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add in what a plan is not what was expected of it (status 1)."""
        self._add("different", code, where, message, hint)

    def warning(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something that the user should look at."""
        self._add("warning", code, where, message, hint)

    def note(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something that the user may want to change."""
        self._add("note", code, where, message, hint)

    def fact(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something worth knowing, a note for which nothing needs to be done."""
        self._add("note", code, where, message, hint, action=False)

    @property
    def in_order(self) -> list[Diagnostic]:
        """Return each finding once, by file, line, column and code.

        Those of IN_TURN stay in the order in which they were found.
        Of a code that a file breaks more than MOST_ALIKE times the first are listed,
        and the next one says how many there are beyond them.
        """
        alike: dict[tuple[Severity, str], list[Diagnostic]] = {}
        found = sorted(dict.fromkeys(self.found), key=_place)
        for finding in found:
            alike.setdefault((finding.severity, finding.code), []).append(finding)
        turn = {finding: k for k, finding in enumerate(found)}
        listed = [d for same in alike.values() for d in _first(same)]
        return sorted(listed, key=lambda d: (_place(d), turn.get(d, len(turn))))

    @property
    def failed(self) -> bool:
        """Return whether any error was found."""
        return any(d.severity == "error" for d in self.found)

    @property
    def refused(self) -> bool:
        """Return whether the answer to anything is no."""
        return any(d.severity in ("infeasible", "different") for d in self.found)

    def _add(
        self,
        severity: Severity,
        code: str,
        where: Span,
        message: str,
        hint: str,
        *,
        action: bool = True,
    ) -> None:
        self.found.append(
            Diagnostic(
                code=code,
                severity=severity,
                where=where,
                message=_shortened(message),
                hint=_shortened(hint),
                action=action,
            )
        )


def render_text(diagnostic: Diagnostic) -> str:
    """Return the finding as text: headline, position, source line, caret."""
    d, where = diagnostic, diagnostic.where
    lines = [f"{d.severity}[{d.code}]: {d.message}"]
    if not where.line:
        lines.append(f"  --> {where.file}")
        return "\n".join(lines + ([f"   = {d.hint}"] if d.hint else []))
    number = str(where.line)
    pad = " " * len(number)
    lines.append(f"{pad}--> {where.file}:{where.line}:{where.column}")
    if where.text:
        shown, caret = _excerpt(where)
        lines += [f"{pad} |", f"{number} | {shown}", f"{pad} | {caret} {d.hint}"]
    elif d.hint:
        lines.append(f"{pad} = {d.hint}")
    return "\n".join(line.rstrip() for line in lines)


def render_line(diagnostic: Diagnostic) -> str:
    """Return the finding as one line of text: kind, code, position, message."""
    d, where = diagnostic, diagnostic.where
    at = f"{where.file}:{where.line}:{where.column}" if where.line else where.file
    return f"{d.severity}[{d.code}] {at} {d.message}"


def _excerpt(where: Span) -> tuple[str, str]:
    """Return a source line, of a long one what is near the caret, and the caret."""
    at = where.column - 1
    first = max(at - EXCERPT // 2, 0) if len(where.text) > EXCERPT else 0
    shown = where.text[first : first + EXCERPT]
    length = min(max(where.length, 1), max(len(shown) - (at - first), 1))
    # a tab stays a tab, so that the caret is where the terminal puts the text
    before = shown[: at - first]
    indent = "".join("\t" if char == "\t" else " " for char in before)
    head = "... " if first else ""
    tail = " ..." if first + EXCERPT < len(where.text) else ""
    return f"{head}{shown}{tail}", " " * len(head) + indent + "^" * length


def _first(found: Sequence[Diagnostic]) -> Sequence[Diagnostic]:
    """Return the first findings of one code, and one that counts the others."""
    more = len(found) - MOST_ALIKE
    if more <= 0:
        return found
    here = found[MOST_ALIKE]
    message = f"{here.message}; and {more - 1} more of {here.code}, not listed"
    return [*found[:MOST_ALIKE], replace(here, message=message)]


def _shortened(text: str) -> str:
    """Return a text without what is beyond MOST_WORDS characters."""
    if len(text) <= MOST_WORDS:
        return text
    return f"{text[:MOST_WORDS]} ... ({len(text) - MOST_WORDS} characters more)"


def _place(diagnostic: Diagnostic) -> tuple[str, int, int, str, str]:
    """Return what findings are sorted by."""
    d, where = diagnostic, diagnostic.where
    words = "" if d.code in IN_TURN else d.message
    return (where.file, where.line, where.column, d.code, words)
