"""Findings in four forms: text, json, GitHub's annotations, SARIF.

All four say the same. With json and sarif, standard output holds one document and
nothing else, the command's result in it; with github, a line per finding before the
result, as the workflow runner reads them.

References
----------
SARIF 2.1.0, OASIS standard (2020); GitHub Docs, "Workflow commands".
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import PurePath
from typing import Any, get_args
from urllib.parse import quote

from microplan.planner.source.diagnostics import (
    TITLES,
    Diagnostic,
    Severity,
    Span,
    render_line,
    render_text,
)

_RANK = {kind: rank for rank, kind in enumerate(get_args(Severity))}
FORMATS = ("text", "json", "github", "sarif")
_GITHUB: Mapping[Severity, str] = {
    "error": "error", "infeasible": "error", "different": "error",
    "warning": "warning", "note": "notice",
}  # fmt: skip
_SARIF: Mapping[Severity, str] = {**_GITHUB, "note": "note"}
_SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"


def render_findings(
    found: Sequence[Diagnostic], result: str, form: str, *, verbose: bool = False
) -> tuple[str, str]:
    """Return what goes to standard output and to standard error.

    Parameters
    ----------
    found : sequence of Diagnostic
        In the order in which they are shown.
    result : str
        What the command found out, in words; empty after an error.
    form : str
        One of `FORMATS`.
    verbose : bool
        Text has the facts too, for which nothing needs to be done; the other forms
        always have them.
    """
    if form == "text":
        return result, _text(found, verbose=verbose)
    return _FORMS[form](found, result)


def _text(found: Sequence[Diagnostic], *, verbose: bool) -> str:
    """Return what needs action, the gravest first, then the facts or their number."""
    asking = sorted((d for d in found if d.action), key=lambda d: _RANK[d.severity])
    facts = [render_line(d) for d in found if not d.action]
    if facts and not verbose:
        ask = "1 note asks" if len(facts) == 1 else f"{len(facts)} notes ask"
        facts = [f"{ask} for nothing: -v shows {'it' if len(facts) == 1 else 'them'}"]
    return "\n".join([*map(render_text, asking), *facts])


def _github(found: Sequence[Diagnostic], result: str) -> tuple[str, str]:
    lines = [_annotation(finding) for finding in found]
    return "\n".join([*lines, *([result] if result else [])]), ""


def _json(found: Sequence[Diagnostic], result: str) -> tuple[str, str]:
    said = {
        "version": _version(),
        "findings": [_plain(finding) for finding in found],
        "result": result,
    }
    return json.dumps(said, indent=2, ensure_ascii=False), ""


def _sarif(found: Sequence[Diagnostic], result: str) -> tuple[str, str]:
    codes = sorted({finding.code for finding in found})
    rules = [
        {"id": code, "shortDescription": {"text": TITLES.get(code, code)}}
        for code in codes
    ]
    driver = {"name": "microplan", "version": _version(), "rules": rules}
    run: dict[str, Any] = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "results": [_sarif_result(finding, codes) for finding in found],
    }
    if result:
        run["properties"] = {"result": result}
    whole = {"$schema": _SARIF_SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(whole, indent=2, ensure_ascii=False), ""


_FORMS: Mapping[str, Callable[[Sequence[Diagnostic], str], tuple[str, str]]] = {
    "json": _json, "github": _github, "sarif": _sarif,
}  # fmt: skip


def _plain(finding: Diagnostic) -> dict[str, Any]:
    """Return a finding as values of JSON; a whole file has neither line nor column."""
    where = finding.where
    placed = {"line": where.line, "column": where.column, "length": where.length}
    return {
        "code": finding.code,
        "severity": finding.severity,
        "title": TITLES.get(finding.code, ""),
        "message": finding.message,
        "hint": finding.hint,
        "action": finding.action,
        "file": where.file,
        **(placed if where.line else {}),
    }


def _annotation(finding: Diagnostic) -> str:
    """Return GitHub's workflow command for a finding."""
    where = finding.where
    keys = {"file": where.file}
    if where.line:
        keys |= {
            "line": str(where.line),
            "col": str(where.column),
            "endColumn": str(where.column + max(where.length, 1)),
        }
    title = f"{finding.code}: {TITLES.get(finding.code, '')}"
    said = ",".join(
        f"{k}={_escaped(v, ',:')}" for k, v in (keys | {"title": title}).items()
    )
    words = finding.message + (f"\n{finding.hint}" if finding.hint else "")
    return f"::{_GITHUB[finding.severity]} {said}::{_escaped(words)}"


def _escaped(text: str, also: str = "") -> str:
    """Return text with the characters that end a workflow command as escapes."""
    for char in "%\r\n" + also:
        text = text.replace(char, f"%{ord(char):02X}")
    return text


def _sarif_result(finding: Diagnostic, codes: Sequence[str]) -> dict[str, Any]:
    """Return one result of a SARIF run."""
    words = finding.message + (f"\n{finding.hint}" if finding.hint else "")
    return {
        "ruleId": finding.code,
        "ruleIndex": codes.index(finding.code),
        "level": _SARIF[finding.severity],
        "message": {"text": words},
        "locations": [{"physicalLocation": _location(finding.where)}],
        "properties": {"severity": finding.severity},
    }


def _location(where: Span) -> dict[str, Any]:
    """Return a position as SARIF has it; file names as relative references."""
    path = quote(PurePath(where.file).as_posix())
    place: dict[str, Any] = {"artifactLocation": {"uri": path}}
    if where.line:
        place["region"] = {
            "startLine": where.line,
            "startColumn": where.column,
            "endColumn": where.column + max(where.length, 1),
        }
    return place


def _version() -> str:
    return metadata.version("microplan")
