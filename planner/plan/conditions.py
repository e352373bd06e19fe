"""What must hold before and after a step, and what to do where it does not."""

from __future__ import annotations

from microplan.planner.assembly.assembly import Axis4
from microplan.planner.assembly.step_states import StepState
from microplan.schemas import plan as p

# What a look may be tried again for, and how often: noise is new every time.
RETRIES = (
    p.OnFailure(code="MP820", do="retry", times=2),
    p.OnFailure(code="MP821", do="retry", times=2),
    p.OnFailure(code="MP822", do="retry", times=1),
    p.OnFailure(code="MP825", do="retry", times=2),
    p.OnFailure(code="MP826", do="retry", times=1),
)


def conditions_of(here: StepState) -> p.Conditions:
    """Return what must hold before and after, and the way back."""
    before, after = _facts(here)
    retreat = _retreat(here) if here.step.verb == "insert" else ()
    return p.Conditions(before=before, after=after, retreat=retreat, on_failure=RETRIES)


def _retreat(insert: StepState) -> tuple[p.AxisMove, ...]:
    """Return the insertion's moves backwards: each back to the reading before it."""
    at: dict[str, Axis4] = {"stage": insert.before.stage, "robot": insert.before.robot}
    back = []
    for move in insert.step.move:
        start = at[move.axes]
        held = {
            name: getattr(start, name)
            for name in ("x_um", "y_um", "z_um", "theta_rad")
            if getattr(move.to, name) is not None
        }
        back.append(p.AxisMove(axes=move.axes, **held))
        at[move.axes] = start.moved(move.to)
    return tuple(reversed(back))


def _facts(here: StepState) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what is true before and after the step, as far as sensors can tell."""
    step = here.step

    def held(name: str | None) -> str:
        return f"{name} is held" if name else "the tool holds nothing"

    before = [held(here.before.held)] if here.before.tool else []
    after = [held(here.after.held)] if here.after.tool else []
    if step.verb in ("locate", "align"):
        after.append(f"{step.target} is measured")
    if step.verb == "align":
        before.append(f"{step.target} and {step.to} are measured")
        after.append(f"{step.target} is at {step.to}")
    return tuple(before), tuple(after)
