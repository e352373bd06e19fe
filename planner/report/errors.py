"""The image before the deciding step, with the ellipse of the error left over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from microplan.planner.report.budgets import LEFT_BY_SERVO
from microplan.planner.report.folder import ReportedPlan
from microplan.planner.report.margins import margins
from microplan.planner.report.outlines import CameraFrame, feature
from microplan.planner.report.pictures import image_id
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import number, um
from microplan.schemas.page.page import Caption, chart, figure
from microplan.schemas.plan import AlignAction, Look, Step

_SIDE = 176.0  # of image and plan view, in units of the chart
_SHARES = (0.68, 0.95)
_FAR_UM = 1e9  # a kilometre: squares of what is farther might be no numbers any more
Covariance = tuple[float, float, float]  # xx, xy, yy


@dataclass(frozen=True, slots=True, kw_only=True)
class _Spread:
    """An error about zero, and how large it may be."""

    look: Look
    step: str
    covariance_um2: Covariance
    room_um: float
    room_name: str
    advice: str


def error_picture(folder: ReportedPlan) -> Element | None:
    """Return a look's image and the ellipse of what is left; None without looks."""
    spread = _of_budget(folder) or _of_look(folder)
    if spread is None:
        return None
    axes = ellipse(spread.covariance_um2)
    words = (
        f"half axes of one sigma {um(axes[0])} and {um(axes[1])}, {spread.room_name} "
        f"{um(spread.room_um)}"
    )
    drawing = chart(
        f"Image of {spread.look.target} with its error ellipse",
        f"Left the predicted image of the look {spread.look.id}, right the error: "
        f"{words}.",
        _image(folder, spread.look),
        [*_plan_view(spread)],
        width=360,
        height=_SIDE + 18,
    )
    caption = Caption(
        title=f"What is left of the error at {spread.step}",
        shows=f"The predicted image of {spread.look.target} and, enlarged, where 68 "
        f"% and "
        f"95 % of the errors lie; the dashed circle is {spread.room_name}, "
        f"{um(spread.room_um)}.",
        judge="Good: the outer ellipse lies well inside the circle; bad: it touches "
        "it.",
        do=spread.advice,
    )
    return figure(caption, drawing)


def ellipse(covariance_um2: Covariance) -> tuple[float, float, float]:
    """Return both half axes of one sigma, the longer first, and its angle."""
    xx, xy, yy = covariance_um2
    middle, apart = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    long, short = middle + apart, max(middle - apart, 0.0)
    return math.sqrt(long), math.sqrt(short), 0.5 * math.atan2(2 * xy, xx - yy)


def sigmas(share: float) -> float:
    """Return the half axis, in sigma, that holds a share of a plane's normal errors."""
    return math.sqrt(-2 * math.log(1 - share))


def _of_budget(folder: ReportedPlan) -> _Spread | None:
    """Return the error of the least likely step with a budget, None if none has one."""
    steps = folder.plan.steps
    found = [s for s in steps if _covariance(s) is not None]
    if not found:
        return None
    step = min(found, key=lambda s: s.budget.success_probability)
    look = _before(folder, step)
    room = step.budget.limit_um
    if look is None or room is None:
        return None
    xx, xy, yy = _covariance(step) or (0.0, 0.0, 0.0)
    left = next(
        (r.sigma_um for r in step.budget.rows if r.term.endswith(LEFT_BY_SERVO)),
        None,
    )
    more = min(abs(left or 0.0), _FAR_UM) ** 2
    name = "the capture radius as drawn" if step.verb == "insert" else "what is allowed"
    return _Spread(
        look=look, step=step.id, covariance_um2=(xx + more, xy, yy + more),
        room_um=room, room_name=name,
        advice="If it is long in one direction, mend what acts along it: the step's "
        "budget names it.",
    )  # fmt: skip


def _covariance(step: Step) -> Covariance | None:
    """Return the covariance of what a servo cannot see, um2; None if unknown."""
    analysis = step.budget.analysis
    return None if analysis is None else analysis.covariance_um2


def _before(folder: ReportedPlan, step: Step) -> Look | None:
    """Return the look of the last alignment before a step, else the last look."""
    steps = folder.plan.steps
    before = steps[: steps.index(step) + 1]
    aligned = [s for s in before if isinstance(s.action, AlignAction) and s.looks]
    looked = aligned or [s for s in before if s.looks]
    return looked[-1].looks[-1] if looked else None


def _of_look(folder: ReportedPlan) -> _Spread | None:
    """Return the error of the look with the least room, None if there is none."""
    tight = next((m.look for m in margins(folder.plan) if m.look), None)
    look = next((la for la in folder.looks if la.id == tight), None)
    if look is None:
        return None
    step = next(s.id for s in folder.plan.steps if look in s.looks)
    variance = look.sigma_xy_um**2
    return _Spread(
        look=look, step=step, covariance_um2=(variance, 0.0, variance),
        room_um=look.evidence.tolerance_um, room_name="the tolerance",
        advice="If it does, look at a higher magnification or allow the step more: a "
        "look passes as long as 2 sigma keep the tolerance.",
    )  # fmt: skip


def _image(folder: ReportedPlan, look: Look) -> Element | None:
    """Return the region of the look's image, with its target marked."""
    if look.scene.image not in folder.pictures:
        return el("text", "no image in the folder", x=8, y=_SIDE / 2)
    region, frame = look.measure.region, CameraFrame.of(folder.plan, look)
    side = 1.3 * max(region.rows, region.columns)
    x = region.column + region.columns / 2 - side / 2
    y = region.row + region.rows / 2 - side / 2
    evidence = folder.evidence.get(look.id)
    marks = [] if evidence is None else [
        el("g", [*feature(folder.world, evidence, mark)], transform=frame.from_world)
        for mark in evidence.features[:1]
    ]  # fmt: skip
    lines = el("g", el("g", marks, class_="case"), el("g", marks, class_="feature"),
               class_="marks")  # fmt: skip
    return el(
        "svg",
        el("rect", x=x, y=y, width=side, height=side, fill="#000"),
        el("use", href=f"#{image_id(look)}", class_="pixels"),
        lines,
        x=0, y=0, width=_SIDE, height=_SIDE,
        viewBox=f"{x:.5g} {y:.5g} {side:.5g} {side:.5g}",
    )  # fmt: skip


def _plan_view(spread: _Spread) -> Iterator[Element]:
    """Yield ellipses, the circle of what is allowed and a scale, y up."""
    long, short, angle = ellipse(spread.covariance_um2)
    room_um = min(max(spread.room_um, 0.0), _FAR_UM)
    reach = 1.12 * max(room_um, sigmas(_SHARES[-1]) * long) or 1.0
    scale = _SIDE / 2 / reach
    cx, cy = 360 - _SIDE / 2, _SIDE / 2
    turn = f"translate({cx:.4g} {cy:.4g}) rotate({-math.degrees(angle):.4g})"
    yield el("path", d=f"M{cx - 80:.4g} {cy:.4g}h160M{cx:.4g} {cy - 80:.4g}v160",
             class_="grid")  # fmt: skip
    for share in _SHARES:
        k = sigmas(share) * scale
        yield el("ellipse", rx=k * long, ry=k * short, transform=turn, class_="ell")
    yield el("circle", cx=cx, cy=cy, r=scale * room_um, class_="room")
    bar = _round(reach / 2)
    x0, y0 = 360 - bar * scale - 4, _SIDE + 4
    yield el("path", d=f"M{x0:.4g} {y0:.4g}h{bar * scale:.4g}", class_="here")
    yield el("text", f"{number(bar)} \u00b5m", x=x0 - 6, y=y0 + 4, class_="end")


def _round(value: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not above a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(k * power for k in (1, 2, 5) if k * power <= value)
