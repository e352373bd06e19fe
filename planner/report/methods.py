"""The methods paragraph to paste, and where everything came from."""

from __future__ import annotations

from microplan.planner.report.folder import ReportedPlan
from microplan.planner.store.summary import CONTRAST
from microplan.schemas.page.elements import Element, Node, el
from microplan.schemas.page.figures import number
from microplan.schemas.page.page import Column, table


def methods(folder: ReportedPlan) -> Element:
    """Return a paragraph that says how the numbers were made, to be pasted."""
    plan, p = folder.plan, folder.plan.provenance
    trials = max(
        (s.trials for look in folder.looks for s in
         (look.evidence.chosen, *look.evidence.others)), default=0,
    )  # fmt: skip
    needs = plan.requirements
    versions = ", ".join(
        f"{name} {said}"
        for name, said in folder.versions.items()
        if name != "microplan"
    )
    libraries = f" ({versions})" if versions else ""
    text = (
        f"The assembly {plan.name} was planned with microplan "
        f"{p.microplan}{libraries}, "
        f"preset {p.preset}, seed {p.seed}, after Feddema and Simon, CAD-Driven "
        "Microassembly and Visual Servoing, ICRA 1998. Images of "
        f"{needs.width_px} \u00d7 {needs.height_px} pixels of {number(needs.pitch_um)} "
        "\u00b5m were predicted from the parts' drawings by incoherent Fourier "
        f"optics; {_errors(folder)} Chains of image routines were tried on up to "
        f"{trials} images a "
        "look with focus, magnification, light and pose disturbed; the chances follow "
        "from the error budget. All of it is simulated. "
    )
    hashes = (
        f"SHA-256 of plan.json {folder.sha256}; of the normalised task "
        f"{p.task_sha256}; "
        f"of the workcell {p.workcell_sha256}."
    )
    return el("p", text, el("span", hashes, class_="hash"), class_="methods")


def _errors(folder: ReportedPlan) -> str:
    """Return what images may err by: what was aimed at, and what the ledgers leave."""
    aim = folder.plan.provenance.max_image_error
    rows = [row for look in folder.looks for row in look.effects]
    worst = max(
        (r.predicted_error or 0.0 for r in rows if r.unit == CONTRAST), default=0
    )
    text = f"each effect was to stay within {number(aim)} of unit contrast"
    if worst <= aim:
        return f"{text}, and does where the effects ledgers give a number."
    return f"{text}; by the effects ledgers up to {number(worst, 2)} is left."


def provenance(folder: ReportedPlan) -> Element:
    """Return every version and hash as a table."""
    p = folder.plan.provenance
    rows: list[list[Node]] = [
        ["plan.json, SHA-256", el("code", folder.sha256)],
        ["plan format", folder.plan.format_version],
        ["task, normalised", el("code", p.task_sha256)],
        ["workcell, normalised", el("code", p.workcell_sha256)],
        *(_row(f"drawing of {name}", el("code", digest))
          for name, digest in p.drawings_sha256.items()),
        ["seed", str(p.seed)],
        ["preset", p.preset],
        ["images: error aimed at", f"{number(p.max_image_error)} of unit contrast"],
        *(_row(name, said) for name, said in folder.versions.items()),
    ]  # fmt: skip
    return table((Column("what"), Column("value")), rows, label="Provenance")


def _row(name: str, value: Node) -> list[Node]:
    return [name, value]
