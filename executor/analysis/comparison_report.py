"""Report on a comparison of runs with their plan, as text or JSON."""

from __future__ import annotations

import json
import math
from typing import Any

from microplan.executor.analysis.comparison import ALPHA, Comparison, Figure
from microplan.executor.record.outcome import columns
from microplan.schemas.codec import to_data
from microplan.schemas.plan import Plan

_HEAD = ("step", "figure", "runs", "mean", "95 %", "sd", "p95", "predicted", "limit")
_CHECKS = ("step", "prediction", "plan", "runs", "chance", "")


def comparison_text(plan: Plan, found: Comparison) -> str:
    """Return the tables of the runs' statistics and of the tests, as text."""
    refuted = found.refuted
    checks = [
        (
            check.step or "plan", check.name, check.predicted, check.found,
            f"{check.chance:.2g}", "REFUTED" if check in refuted else "",
        )
        for check in found.checks
    ]  # fmt: skip
    lines = [
        f"{plan.name}: runs: {len(found.runs)}, done: {found.done} of {found.counted}",
        "",
        columns([_HEAD, *map(_row, found.figures)]) if found.figures else "",
        "",
        columns([_CHECKS, *checks]) if checks else "nothing to test",
        "",
        f"{len(refuted)} of {len(checks)} predictions refuted",
        f"a false alarm among all of them has a chance of at most {ALPHA:g} (Holm)",
    ]
    lines += [f"left apart: {run.folder.name}, {run.apart}" for run in found.apart]
    return "\n".join(lines)


def comparison_json(plan: Plan, found: Comparison) -> str:
    """Return the same as one JSON object; what is not known is null."""
    refuted = found.refuted
    data = {
        "plan": plan.name,
        "runs": [str(run.folder) for run in found.runs],
        "left_apart": {str(run.folder): run.apart for run in found.apart},
        "done": found.done,
        "counted": found.counted,
        "figures": [_figure_data(figure) for figure in found.figures],
        "checks": [
            {**to_data(check), "refuted": check in refuted} for check in found.checks
        ],
    }
    return json.dumps(data, indent=2, ensure_ascii=False)


def _row(figure: Figure) -> tuple[str, ...]:
    """Return the cells of one figure."""
    one, unit = figure.runs, f" {figure.unit}".rstrip()
    known = math.isfinite(one.low)
    return (
        figure.step,
        figure.name + unit,
        str(one.count),
        f"{one.mean:.4g}",
        f"{one.low:.3g}..{one.high:.3g}" if known else "-",
        _number(figure.sd),
        f"{figure.p95:.3g}",
        _number(figure.predicted),
        _number(figure.limit),
    )


def _figure_data(figure: Figure) -> dict[str, Any]:
    """Return one figure as JSON data."""
    one = figure.runs
    return {
        "step": figure.step,
        "figure": figure.name,
        "unit": figure.unit,
        "runs": one.count,
        "mean": to_data(one.mean),
        "low": to_data(one.low) if math.isfinite(one.low) else None,
        "high": to_data(one.high) if math.isfinite(one.high) else None,
        "sd": to_data(figure.sd),
        "p95": to_data(figure.p95),
        "predicted": to_data(figure.predicted),
        "limit": to_data(figure.limit),
    }


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
