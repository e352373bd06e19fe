"""The looks of a sketch in the report: what each shows, nothing measured."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.planner.report.folder import ReportedPlan
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import number, quantity, um
from microplan.schemas.page.page import Caption, facts, figure, png_uri
from microplan.schemas.plan import SketchedLook


def sketch_section(folder: ReportedPlan) -> Element:
    """Return all looks of a sketch."""
    looks = [_look(folder, look) for look in folder.plan.sketched]
    none = el("p", "No look has a view.")
    return el("section", el("h2", "Looks"), looks or none, id="looks")


def sketch_contents(folder: ReportedPlan) -> Iterator[tuple[str, str]]:
    """Yield name and id of what the page of a sketch has of looks."""
    yield "Looks", "looks"
    for look in folder.plan.sketched:
        yield look.id, _id(look)


def _id(look: SketchedLook) -> str:
    return slug("look", look.id)


def _look(folder: ReportedPlan, look: SketchedLook) -> Element:
    """Return the setting and the picture of one look."""
    view, path = look.view, look.scene.image
    pairs: list[tuple[str, Node]] = [
        ("step", look.step),
        ("magnification", f"{number(view.magnification)} \u00d7"),
        ("plane in focus", quantity(view.focus_um, "\u00b5m")),
        ("field", f"{um(view.field_um[0])} by {um(view.field_um[1])}"),
        *(
            (f"{shade.target}, by {shade.by}", _shaded(shade.hidden, shade.shaded))
            for shade in look.scene.shades
        ),
    ]
    caption = Caption(
        title=f"What the camera should see: {look.target}",
        shows=f"The whole frame predicted for the look at {number(view.magnification)} "
        "times, all things at their nominal places.",
        judge="Good: the edges of the target are sharp and free; bad: another body "
        "hides or shades them, or they end at the frame.",
        do="Compile the task to learn how well it is measured.",
    )
    data = folder.pictures.get(path)
    words = f"Predicted image of {look.target} in the look {look.id}"
    shown = (
        el("p", f"{path} is not the image that this plan is of, or not in the folder.",
           class_="bad")
        if data is None
        else el("img", src=png_uri(data), alt=words)
    )  # fmt: skip
    head = el("h3", f"Look {look.id}: {look.target}")
    return el("section", head, facts(pairs), figure(caption, shown), id=_id(look))


def _shaded(hidden: float, shaded: float) -> str:
    """Return what shares of a target's edges another body hides and shades."""
    return f"{100 * hidden:.0f} % of its edges hidden, {100 * shaded:.0f} % shaded"
