"""Findings: where in the user's files, what, and how to mend it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A place in a file; line and column count from 1, line 0 means the whole file."""

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


@dataclass(slots=True)
class Report:
    """Collects the findings of one compile: the only state that stages share."""

    found: list[Diagnostic] = field(default_factory=list)

    def error(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something that makes the input unusable (exit status 2)."""
        self._add("error", code, where, message, hint)

    def warning(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something that the user should look at."""
        self._add("warning", code, where, message, hint)

    def note(self, code: str, where: Span, message: str, hint: str = "") -> None:
        """Add something worth knowing."""
        self._add("note", code, where, message, hint)

    @property
    def failed(self) -> bool:
        """Return whether any error was found."""
        return any(d.severity == "error" for d in self.found)

    def _add(
        self, severity: Severity, code: str, where: Span, message: str, hint: str
    ) -> None:
        self.found.append(
            Diagnostic(
                code=code, severity=severity, where=where, message=message, hint=hint
            )
        )


def render_text(diagnostic: Diagnostic) -> str:
    """Return the finding as text: headline, place, source line and caret."""
    d, where = diagnostic, diagnostic.where
    lines = [f"{d.severity}[{d.code}]: {d.message}"]
    if not where.line:
        lines.append(f"  --> {where.file}")
        return "\n".join(lines + ([f"   = {d.hint}"] if d.hint else []))
    number = str(where.line)
    pad = " " * len(number)
    lines.append(f"{pad}--> {where.file}:{where.line}:{where.column}")
    if where.text:
        caret = " " * (where.column - 1) + "^" * max(where.length, 1)
        lines += [f"{pad} |", f"{number} | {where.text}", f"{pad} | {caret} {d.hint}"]
    elif d.hint:
        lines.append(f"{pad} = {d.hint}")
    return "\n".join(line.rstrip() for line in lines)
