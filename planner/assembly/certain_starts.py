"""Starts that count as exactly known because the task states no spread."""

from __future__ import annotations

from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task


def report_certain(task: Task, report: Report) -> None:
    """Note parts whose place, or angle, has no spread: looks and budgets believe it."""
    for start in task.part_starts.values():
        known = [
            words
            for words, sigma in (
                ("place", start.sigma_xy_um),
                ("angle", 1.0 if start.theta_any else start.sigma_theta_rad),
            )
            if sigma == 0
        ]
        if known:
            report.note(
                "MP309",
                start.where,
                f"{start.name} starts without a spread of its {' and '.join(known)}: "
                "looks and budgets take it as exactly known",
                "state sigma_xy_um and sigma_theta_deg, one standard deviation each",
            )
