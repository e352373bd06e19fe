"""The report of a plan folder as one page of HTML."""

from __future__ import annotations

from pathlib import Path

from microplan.planner.diff.diffing import plan_file
from microplan.planner.report.findings import findings_section
from microplan.planner.report.first_page import contents, first_page
from microplan.planner.report.folder import ReportedPlan, read_folder
from microplan.planner.report.margins import provenance
from microplan.planner.report.outlines import definitions
from microplan.planner.report.sketched import sketch_section
from microplan.planner.report.steps import step_section, timeline
from microplan.planner.store.folder import REPORT, replace_alike
from microplan.schemas.page.elements import el
from microplan.schemas.page.page import document, link

_FOOT = (
    "One file, no scripts, nothing fetched. Lengths are of the object; a spread is one "
    "standard deviation per axis."
)


def plan_report(folder: ReportedPlan) -> str:
    """Return the report; the same plan folder gives the same bytes."""
    plan = folder.plan
    toc = [el("li", link(name, place)) for name, place in contents(folder)]
    steps = [step_section(folder, k, step) for k, step in enumerate(plan.steps, 1)]
    drawn = [*timeline(plan, folder.world)]
    times = el("section", el("h2", "Timeline"),
               drawn or el("p", "The plan has no steps."), id="timeline")  # fmt: skip
    nav = el(
        "nav", el("h2", "Contents"), el("ul", toc, class_="contents"),
        aria_label="Contents", id="contents",
    )  # fmt: skip
    main = el(
        "main",
        first_page(folder),
        nav,
        sketch_section(folder) if plan.is_sketch else times,
        steps,
        findings_section(folder.findings),
        el("section", el("h2", "Provenance"), provenance(folder), id="provenance"),
        id="main",
    )  # fmt: skip
    return document(
        f"{plan.name} \u2013 microplan report",
        None if folder.world is None else definitions(folder.world),
        el(
            "header",
            el("p", "microplan report of a simulated plan", class_="kicker"),
            el("h1", plan.name),
        ),
        main,
        el("footer", el("p", _FOOT)),
    )  # fmt: skip


def write_report(path: Path, out: Path | None) -> Path:
    """Write the report of a plan folder, and return where it is.

    Parameters
    ----------
    path : Path
        The plan folder, or its plan.json.
    out : Path, optional
        The file; default: `REPORT` in the plan folder.

    Raises
    ------
    DiffError
        MP704 if there is no plan that can be read.
    OutputError
        MP702 if the report cannot be written, MP703 if another file is there.
    """
    text = plan_report(read_folder(path))
    file = out or plan_file(path).with_name(REPORT)
    data = text.encode()
    replace_alike(file, data, head=data.index(b"<title>"))
    return file
