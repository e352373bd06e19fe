"""What is said of measured pictures: a line each, in words or as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field

import numpy as np

from microplan.planner.measure.measuring import AnswerGate, MeasuredPicture
from microplan.planner.measure.picture_look import PictureLook

GREY = "colours are measured as grey: .2125 red + .7154 green + .0721 blue"


def text_line(look: PictureLook, found: MeasuredPicture, *, verbose: bool) -> str:
    """Return a picture's line in words; with `verbose` gates that passed, too."""
    target = look.case.target.name
    if found.failure:
        return f"{found.name}: {target} not found: {found.failure}"
    words = [f"{found.name}: {target} at {found.x_um:z.3f}, {found.y_um:z.3f} um"]
    words[0] += f" (column {found.column_px:z.3f}, row {found.row_px:z.3f} px)"
    if found.theta_rad is not None:
        words.append(f"{math.degrees(found.theta_rad):z.3f} deg")
    if found.axis_rad is not None:
        words.append(f"known along {math.degrees(found.axis_rad):z.1f} deg alone")
    words.append(f"repeats to {found.repeatability_um:.2g} um")
    if look.trueness_um is not None:
        words.append(f"true to {look.trueness_um:.2g} um")
    return f"{', '.join(words)}; {_verdict(found, verbose=verbose)}"


def _verdict(found: MeasuredPicture, *, verbose: bool) -> str:
    """Return whether an answer is accepted, gate by gate where that matters."""
    shown = [g for g in found.gates if verbose or not g.passed]
    verdict = "accepted" if found.is_accepted else "refused"
    if not shown:
        return verdict
    return f"{verdict}: {'; '.join(map(_gate_words, shown))}"


def _gate_words(gate: AnswerGate) -> str:
    """Return a gate's value and limit."""
    if gate.name == "score":
        return f"score {gate.value:.2f}, needs {gate.limit:.2f}"
    return f"{gate.name} {gate.value:.3g} um, at most {gate.limit:.3g} um"


def json_line(look: PictureLook, found: MeasuredPicture) -> str:
    """Return a picture's line as a JSON object; what is infinite or unknown is null."""
    gates = [
        {"name": g.name, "value": g.value, "limit": g.limit, "passed": g.passed}
        for g in found.gates
    ]
    why = found.failure or "; ".join(
        _gate_words(g) for g in found.gates if not g.passed
    )
    said = {
        "name": found.name,
        "accepted": found.is_accepted,
        "x_um": found.x_um,
        "y_um": found.y_um,
        "theta_deg": _degrees(found.theta_rad),
        "axis_deg": _degrees(found.axis_rad),
        "column_px": found.column_px,
        "row_px": found.row_px,
        "repeatability_um": found.repeatability_um,
        "trueness_um": look.trueness_um,
        "limit_um": look.limit_um,
        "gates": gates,
        "why": why,
    }
    return json.dumps(_finite(said), ensure_ascii=False, allow_nan=False)


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)


def _finite(value: object) -> object:
    """Return a value of JSON with null for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(slots=True, kw_only=True)
class AnswerTally:
    """How many pictures were measured, and where accepted targets are."""

    count: int = 0
    accepted_um: list[tuple[float, float]] = field(default_factory=list)

    def add(self, found: MeasuredPicture) -> None:
        """Count one more picture."""
        self.count += 1
        if found.is_accepted and found.x_um is not None and found.y_um is not None:
            self.accepted_um.append((found.x_um, found.y_um))

    @property
    def all_accepted(self) -> bool:
        """Return whether no picture was refused."""
        return len(self.accepted_um) == self.count

    def closing(self, look: PictureLook) -> str:
        """Return what is said at the end, in words."""
        zoom = look.case.microscope.magnification
        lines = [f"measured by {', '.join(look.chain)} at {zoom:.4g} x"]
        if look.limit_um is not None:
            lines[0] += f"; the Cramer-Rao limit is {look.limit_um:.2g} um"
        if self.count > 1:
            lines.insert(0, f"{len(self.accepted_um)} of {self.count} accepted")
        if len(self.accepted_um) > 1:
            x_um, y_um = np.std(self.accepted_um, axis=0, ddof=1)
            lines[0] += f"; their places vary by {x_um:.2g} um in x, {y_um:.2g} um in y"
            lines[0] += ", one standard deviation"
        return "\n".join(lines)
