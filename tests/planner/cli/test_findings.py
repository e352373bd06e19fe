"""Findings in all four forms."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace

import pytest

from microplan.planner.cli.arguments import Run, build_parser
from microplan.planner.cli.findings import FORMATS, render_findings
from microplan.planner.source.diagnostics import Diagnostic, Severity, Span

WHERE = Span(file="a dir/task.yaml", line=3, column=5, length=4, text="  sead: 1")


def finding(
    severity: Severity = "error", where: Span = WHERE, message: str = "unknown key"
) -> Diagnostic:
    return Diagnostic(
        code="MP104", severity=severity, where=where, message=message, hint="seed?"
    )


def test_every_form_can_be_asked_for() -> None:
    runs: Mapping[str, Run] = defaultdict(lambda: lambda _call: 0)
    for form in FORMATS:
        call = build_parser(runs).parse_args(["check", "t.yaml", "--format", form])
        assert call.format == form


def test_json_says_what_text_says() -> None:
    out, err = render_findings(
        [finding(), finding("note", Span(file="b"))], "ok", "json"
    )
    assert err == ""
    said = json.loads(out)
    assert said["result"] == "ok"
    assert said["findings"][0] == {
        "code": "MP104", "severity": "error", "title": "unknown key",
        "message": "unknown key", "hint": "seed?", "action": True,
        "file": "a dir/task.yaml", "line": 3, "column": 5, "length": 4,
    }  # fmt: skip
    assert "line" not in said["findings"][1]


@pytest.mark.parametrize(
    ("severity", "command"),
    [
        ("error", "error"),
        ("infeasible", "error"),
        ("different", "error"),
        ("warning", "warning"),
        ("note", "notice"),
    ],
)
def test_an_annotation_is_one_line_whatever_it_says(
    severity: Severity, command: str
) -> None:
    nasty = finding(severity, message="50 %\n::error::x, y: z")
    out, _ = render_findings([nasty], "done", "github")
    line, result = out.split("\n")
    assert result == "done"
    head, _, words = line.removeprefix("::").partition("::")
    assert head.startswith(f"{command} file=a dir/task.yaml,line=3,col=5,endColumn=9,")
    # what GitHub's runner undoes
    for code, char in (("%0A", "\n"), ("%0D", "\r"), ("%25", "%")):
        words = words.replace(code, char)
    assert words == "50 %\n::error::x, y: z\nseed?"


def test_sarif_places_results_and_describes_their_rules() -> None:
    found = [finding(), finding("infeasible", Span(file="b.yaml")), finding("warning")]
    (run,) = json.loads(render_findings(found, "", "sarif")[0])["runs"]
    assert [r["level"] for r in run["results"]] == ["error", "error", "warning"]
    rules = run["tool"]["driver"]["rules"]
    assert all(rules[r["ruleIndex"]]["id"] == r["ruleId"] for r in run["results"])
    first, whole = (r["locations"][0]["physicalLocation"] for r in run["results"][:2])
    assert first["artifactLocation"]["uri"] == "a%20dir/task.yaml"
    assert first["region"] == {"startLine": 3, "startColumn": 5, "endColumn": 9}
    assert "region" not in whole
    assert "properties" not in run


def test_text_keeps_the_result_apart_from_the_findings() -> None:
    out, err = render_findings([finding()], "done", "text")
    assert out == "done"
    assert err.startswith("error[MP104]: unknown key")
    assert render_findings([], "", "text") == ("", "")


def test_text_has_what_needs_action_first_and_facts_in_one_line() -> None:
    fact = replace(finding("note"), action=False)
    found = [fact, finding("note"), finding("error"), fact]
    short = render_findings(found, "", "text")[1].splitlines()
    heads = [line for line in short if line.startswith(("error", "note"))]
    assert [head.partition(":")[0] for head in heads] == ["error[MP104]", "note[MP104]"]
    assert short[-1] == "2 notes ask for nothing: -v shows them"
    every = render_findings(found, "", "text", verbose=True)[1].splitlines()
    assert every[:-2] == short[:-1]
    assert every[-2:] == 2 * ["note[MP104] a dir/task.yaml:3:5 unknown key"]


@pytest.mark.parametrize("form", ["json", "github", "sarif"])
def test_forms_for_machines_have_the_facts_too(form: str) -> None:
    fact = replace(finding("note"), action=False)
    out, _ = render_findings([fact], "", form)
    assert "unknown key" in out
    assert out == render_findings([fact], "", form, verbose=True)[0]


def test_no_finding_says_nothing() -> None:
    assert render_findings([], "", "text") == ("", "")
