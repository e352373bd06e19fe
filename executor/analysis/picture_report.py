"""Report on pictures of a look: a line each, then tests over all of them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from microplan.executor.analysis.distributions import (
    Mean,
    MeasuredScatter,
    Share,
    mean,
    scatter,
    share,
)
from microplan.executor.analysis.pictures import Attempt, Finding, Viewer
from microplan.executor.devices.errors import CODES
from microplan.executor.record.outcome import columns
from microplan.executor.run.gates import GateValue
from microplan.schemas.codec import to_data

ALPHA = 0.05  # of a false alarm in all that is asked together
_HEAD = (
    "picture", "result", "x um", "y um", "turn deg", "score", "sigma um (px)",
    "off um", "by", "light contrast sharpness",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureTotals:
    """Tests of the plan's predictions by all pictures; None where there are too few."""

    found: Share
    still: bool  # nothing was moved between the pictures, by the user's statement
    place: MeasuredScatter | None
    turn: MeasuredScatter | None
    off_x_um: Mean | None  # from where the plan has the target
    off_y_um: Mean | None

    @property
    def refuted(self) -> tuple[str, ...]:
        """Return the refuted predictions, at the level `ALPHA` over all questions."""
        asked = {"found": self.found.chance}
        if self.still and self.place is not None:
            asked["scatter"] = self.place.chance
        if self.still and self.turn is not None:
            asked["turn"] = self.turn.chance
        return tuple(k for k, v in asked.items() if v < ALPHA / len(asked))


def together(
    seer: Viewer, findings: Sequence[Finding], *, still: bool = False
) -> PictureTotals:
    """Return the tests of the look's predictions by the pictures that could be used.

    Their scatter is judged only if nothing was moved between them.
    """
    look = seer.look
    used = [f for f in findings if f.attempts]
    good = [f for f in used if f.found]
    score = look.evidence.chosen
    lower = (
        score.success_lower if look.together is None else look.together.success_lower
    )
    at = [(f.x_um or 0.0, f.y_um or 0.0) for f in good]
    turns = [f.theta_rad for f in good if f.theta_rad is not None]
    sigma_theta = look.sigma_theta_rad
    upper = None if look.together is not None else score.sigma_upper_um
    return PictureTotals(
        found=share(len(good), len(used), lower),
        still=still,
        place=_scatter(at, look.sigma_xy_um, upper),
        turn=None
        if sigma_theta is None or len(turns) < 2
        else _turns(turns, sigma_theta),
        off_x_um=mean([x - seer.expected.x_um for x, _ in at]) if len(at) > 1 else None,
        off_y_um=mean([y - seer.expected.y_um for _, y in at]) if len(at) > 1 else None,
    )


def report_text(
    seer: Viewer, findings: Sequence[Finding], all_of_them: PictureTotals
) -> str:
    """Return the table, the reasons of refusals, and the tests over all pictures."""
    rows = [_HEAD, *(_row(f, seer.look.view.um_per_px) for f in findings)]
    lines = [columns(rows), ""]
    for f in findings:
        if not f.found:
            lines.append(f"{f.name}: {CODES[str(f.code)][0]} [{f.code}]: {f.why}")
        if f.spare_used:
            fault = next(a.why for a in f.attempts if a.code is not None)
            lines.append(f"{f.name}: the fallback found it; {fault}")
        if f.looks is not None and f.looks.words:
            lines.append(f"{f.name}: {'; '.join(f.looks.words)}")
        if f.hint:
            lines.append(f"{f.name}: {f.hint}")
    return "\n".join([*lines, *_summary(all_of_them)])


def report_json(
    seer: Viewer, findings: Sequence[Finding], all_of_them: PictureTotals
) -> str:
    """Return the same as one JSON object."""
    data = {
        "plan": seer.plan.name,
        "look": seer.look.id,
        "target": seer.look.target,
        "um_per_px": seer.look.view.um_per_px,
        "pictures": [_finding_data(f, seer.look.view.um_per_px) for f in findings],
        "together": _finite(all_of_them),
        "refuted": list(all_of_them.refuted),
    }
    return json.dumps(data, indent=2, ensure_ascii=False)


def _scatter(
    at: Sequence[tuple[float, float]], sigma_um: float, upper_um: float | None
) -> MeasuredScatter | None:
    """Return the standard deviation of positions about their mean, per axis, um."""
    if len(at) < 2:
        return None
    middle = [sum(v) / len(at) for v in zip(*at, strict=True)]
    squares = sum((x - middle[0]) ** 2 + (y - middle[1]) ** 2 for x, y in at)
    return scatter(squares, 2 * (len(at) - 1), sigma_um, upper_um)


def _turns(turns: Sequence[float], sigma_rad: float) -> MeasuredScatter:
    """Return the standard deviation of angles about their mean direction, rad."""
    middle = math.atan2(sum(map(math.sin, turns)), sum(map(math.cos, turns)))
    off = [math.remainder(t - middle, math.tau) for t in turns]
    about = sum(off) / len(off)
    return scatter(sum((t - about) ** 2 for t in off), len(turns) - 1, sigma_rad)


def _counted(finding: Finding) -> Attempt | None:
    """Return the attempt that counts: the first accepted, else the first made."""
    good = [a for a in finding.attempts if a.code is None]
    return next(iter(good or finding.attempts), None)


def _row(finding: Finding, um_per_px: float) -> tuple[str, ...]:
    """Return the cells of one picture."""
    attempt = _counted(finding)
    gates = {g.name: g for g in attempt.gates} if attempt is not None else {}
    spread_um = gates.get("spread")
    px = "" if spread_um is None else f" ({spread_um.value / um_per_px:.3f})"
    spare = " (fallback)" if attempt is not None and attempt.spare else ""
    turn = finding.theta_rad
    return (
        finding.name,
        "found" if finding.found else str(finding.code),
        _number(finding.x_um),
        _number(finding.y_um),
        "-" if turn is None else f"{math.degrees(turn):.3f}",
        _gate(gates.get("score")),
        _gate(spread_um) + px,
        _gate(gates.get("shift")),
        "-" if attempt is None else ", ".join(attempt.chain) + spare,
        _looks(finding),
    )


def _summary(found: PictureTotals) -> list[str]:
    """Return the lines about all pictures together."""
    one, wrong = found.found, found.refuted
    lines = [
        "",
        f"found in {one.hits} of {one.trials} pictures, {one.low:.3f}..{one.high:.3f} "
        f"at 95 %; the plan promises at least {one.predicted:.3f}"
        + _flag("found" in wrong),
    ]
    if found.place is not None:
        lines.append(
            _spread_line("scatter", found.place, 1.0, "um") + _flag("scatter" in wrong)
        )
    if found.turn is not None:
        degrees = math.degrees(1.0)
        lines.append(
            _spread_line("scatter of the angle", found.turn, degrees, "deg")
            + _flag("turn" in wrong)
        )
    if found.off_x_um is not None and found.off_y_um is not None:
        words = ", ".join(
            f"{axis} {one.mean:.4g} um ({one.low:.4g}..{one.high:.4g})"
            for axis, one in (("x", found.off_x_um), ("y", found.off_y_um))
        )
        lines.append(
            f"mean place off the plan's by {words}: where it stood, and any bias"
        )
    if found.place is not None and not found.still:
        lines.append("scatter is not judged: say --still if nothing was moved between")
    if wrong:
        lines.append(
            f"REFUTED: chance explains as much in fewer than {ALPHA:g} of cases, all "
            "questions together"
        )
    return lines


def _spread_line(name: str, one: MeasuredScatter, scale: float, unit: str) -> str:
    """Return a standard deviation in words."""
    sigma, low, high, plan, most = (
        v * scale for v in (one.sigma, one.low, one.high, one.predicted, one.most)
    )
    return (
        f"{name} {sigma:.4g} {unit} per axis, {low:.4g}..{high:.4g} at 95 %; the plan "
        f"has {plan:.4g} {unit}, at most {most:.4g} {unit}; chi-square "
        f"{one.chi_square:.4g} of {one.freedom}"
    )


def _finding_data(finding: Finding, um_per_px: float) -> dict[str, Any]:
    """Return one picture as JSON data."""
    return {
        "picture": finding.name,
        "code": finding.code,
        "why": finding.why,
        "x_um": finding.x_um,
        "y_um": finding.y_um,
        "theta_rad": finding.theta_rad,
        "fallback": finding.spare_used,
        "attempts": [_attempt_data(a, um_per_px) for a in finding.attempts],
        "hint": finding.hint,
        "likeness": None if finding.looks is None else _finite(finding.looks),
    }


def _attempt_data(attempt: Attempt, um_per_px: float) -> dict[str, Any]:
    """Return one chain on one feature as JSON data."""
    shown = attempt.shown
    return {
        "feature": attempt.feature,
        "chain": list(attempt.chain),
        "fallback": attempt.spare,
        "code": attempt.code,
        "why": attempt.why,
        "x_um": None if shown is None else _json(shown.seen.x_um),
        "y_um": None if shown is None else _json(shown.seen.y_um),
        "theta_rad": None if shown is None else _json(shown.seen.theta_rad),
        "sigma_um": None if shown is None else _json(shown.spread_um),
        "sigma_px": None if shown is None else _json(shown.spread_um / um_per_px),
        "gates": [{**_finite(gate), "passed": gate.passed} for gate in attempt.gates],
    }


def _finite(value: Any) -> Any:
    """Return dataclasses as JSON data; what is not finite is null."""
    found = {name: getattr(value, name) for name in value.__dataclass_fields__}
    return {
        k: _finite(v) if hasattr(v, "__dataclass_fields__") else _json(v)
        for k, v in found.items()
    }


def _json(value: Any) -> Any:
    """Return a value as JSON has it."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return to_data(value)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _gate(gate: GateValue | None) -> str:
    """Return value and limit; what does not pass is marked."""
    if gate is None:
        return "-"
    sign = ">=" if gate.least else "<="
    mark = "" if gate.passed else " NO"
    return f"{gate.value:.3g} {sign} {gate.limit:.3g}{mark}"


def _looks(finding: Finding) -> str:
    """Return the ratios to the reference."""
    like = finding.looks
    if like is None:
        return "-"
    return " ".join(
        "-" if v is None else f"{v:.2f}"
        for v in (like.brightness, like.contrast, like.sharpness)
    )


def _flag(wrong: bool) -> str:  # noqa: FBT001 - a predicate
    return "  REFUTED" if wrong else ""
