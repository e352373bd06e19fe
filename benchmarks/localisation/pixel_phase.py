"""How `contour_match` errs with the place between two pixels, for the laser's fingers.

python -m benchmarks.localisation.pixel_phase prints the table of docs/closed-loop.md.
No noise: what is left is the sampling of the edges.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour import match as contour_match
from microplan.featuresel.routines.contract import Artifact, Failure, Guess
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views

TASK = Path(__file__).parents[2] / "examples" / "laser_die" / "task.yaml"
STEP = "see_fingers"
PHASES = np.linspace(-0.5, 0.5, 9)  # px
TURNS_RAD = (0.0, 0.008)
IMAGE_ERROR = 0.005  # that of preset fast


def look() -> LookCase:
    """Return the look at the fingers at its first zoom."""
    report = Report()
    task = load_task(TASK, report)
    if task is None:
        raise SystemExit(f"{TASK}: {[d.message for d in report.found]}")
    states = unfold(task, report)
    at = next(k for k, s in enumerate(states) if s.step.id == STEP)
    request = requests(task, states, at, None)[0]
    low, _ = task.workcell.optics.magnification
    view = views(task, request, low, report)[0]
    return build_case(task, request, view, IMAGE_ERROR)[0]


def errors_nm(case: LookCase, turn_rad: float) -> list[float]:
    """Return the error in y at every phase."""
    render, target = nominal_render(case), case.target
    artifact = contour_match.prepare(render, target)
    if not isinstance(artifact, Artifact):
        raise SystemExit(artifact.message)
    found = []
    for phase in PHASES:
        image = render(dy_um=phase / target.px_per_um, theta_rad=turn_rad)
        guess = Guess(
            column=target.column,
            row=target.row - phase,
            theta_rad=target.theta_rad + turn_rad,
        )
        seen = contour_match.measure(image, artifact, guess)
        if isinstance(seen, Failure):
            raise SystemExit(seen.message)
        found.append((guess.row - seen.row) / target.px_per_um * 1e3)
    return found


def main() -> int:
    """Print the table."""
    case = look()
    print("| turn mrad |", " | ".join(f"{p:+.3f}" for p in PHASES), "|")
    print("|---" * (1 + len(PHASES)) + "|")
    for turn_rad in TURNS_RAD:
        cells = " | ".join(f"{error:.0f}" for error in errors_nm(case, turn_rad))
        print(f"| {turn_rad * 1e3:g} | {cells} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
