"""Findings as text, and their order."""

from __future__ import annotations

from microplan.planner.source.diagnostics import Diagnostic, Report, Span, render_text


def finding(where: Span, hint: str = "did you mean 'wavelength_um'?") -> Diagnostic:
    return Diagnostic(
        code="MP104",
        severity="error",
        where=where,
        message="unknown key 'wavelenght_um' in optics",
        hint=hint,
    )


def test_a_finding_is_drawn_as_in_the_design() -> None:
    where = Span(
        file="workcell.yaml", line=12, column=3, length=13,
        text="  wavelenght_um: 0.6",
    )  # fmt: skip
    assert render_text(finding(where)) == (
        "error[MP104]: unknown key 'wavelenght_um' in optics\n"
        "  --> workcell.yaml:12:3\n"
        "   |\n"
        "12 |   wavelenght_um: 0.6\n"
        "   |   ^^^^^^^^^^^^^ did you mean 'wavelength_um'?"
    )


def test_a_tab_before_the_place_stays_a_tab() -> None:
    where = Span(file="t.yaml", line=1, column=4, length=1, text="a\t: x")
    assert render_text(finding(where, "")).splitlines()[-1] == "  |  \t ^"


def test_a_finding_about_a_whole_file_has_no_caret() -> None:
    assert render_text(finding(Span(file="t.yaml"), "write one")) == (
        "error[MP104]: unknown key 'wavelenght_um' in optics\n"
        "  --> t.yaml\n"
        "   = write one"
    )


def test_findings_are_shown_once_and_by_place() -> None:
    report = Report()
    for line, code in ((7, "MP110"), (2, "MP104"), (7, "MP101"), (7, "MP110")):
        report.error(code, Span(file="a.yaml", line=line), "x")
    report.warning("MP210", Span(file="A.yaml", line=9), "x")
    shown = [(d.where.file, d.where.line, d.code) for d in report.in_order]
    assert shown == [
        ("A.yaml", 9, "MP210"), ("a.yaml", 2, "MP104"),
        ("a.yaml", 7, "MP101"), ("a.yaml", 7, "MP110"),
    ]  # fmt: skip
    assert report.failed


def test_warnings_and_notes_do_not_fail() -> None:
    report = Report()
    report.warning("MP210", Span(file="a.yaml"), "x")
    report.note("MP211", Span(file="a.yaml"), "x")
    assert not report.failed
