"""What the planner makes of a task before any image, and how two of them compare.

Of an edit that does not change the meaning is required:

- in other units, with circles as arcs, in another order or in a block: the normalised
  task is the same to the last digit, and so are the digests in the plan's provenance;
- with other names: the same after the names are put back;
- turned with its camera: every place turned back is the same within TURNED_UM.

Places are compared within SAME_UM, as coordinates are read from decimals of PLACES
digits in other units, at up to 1e5 times their last bit. Names go into the keys of the
random draws, so trials of renamed parts see other noise: their scores may differ as
those of two seeds do, the settings and scenes may not.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import flatten
from microplan.planner.assembly.step_states import unfold
from microplan.planner.plan.task_records import feature_places
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.views.check_task import check_fits
from microplan.planner.views.requests import requests
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.target_views import views
from microplan.schemas.codec import to_data
from tests.planner.random_jobs import Form, turned

SAME_UM = 1e-8  # 1e-11 of a millimetre: doubles of mm and inches end at 1e-13
CHORD_UM = 1.0  # of the corners by which outlines are compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What is known of a task before anything is rendered; names put back."""

    normalised: str
    findings: tuple[tuple[str, str], ...]  # severity and code
    words: tuple[str, ...]  # messages, names put back
    numbers: Mapping[str, FloatArray]  # by what they are; points are (N, 2) um


def look_at(file: Path, form: Form) -> Seen:
    """Return what the planner knows of a task that was written in a form."""
    report = Report()
    task = load_task(file, report)
    numbers: dict[str, FloatArray] = {}
    normalised = ""
    if task is not None:
        places = {f.name: (f.x_um, f.y_um) for f in feature_places(task)}
        whole = {"task": task.normalised, "places": to_data(places)}
        normalised = json.dumps(whole, sort_keys=True)
        states = unfold(task, report)
        if not report.failed:
            check_fits(task, states, report)
            for index in range(len(states)):
                for request in requests(task, states, index, 3.0):
                    low, _ = task.workcell.optics.magnification
                    key = request.id
                    found = views(task, request, low, report)
                    numbers |= _settings(key, found)
                    scene = world_scene(task, request.state)
                    numbers |= _faces(key, scene.layers, form)
                    numbers |= _beliefs(key, request.state, form)
    back = {new: old for old, new in form.names.items()}
    return Seen(
        normalised=_renamed(normalised, back),
        findings=tuple(sorted((d.severity, d.code) for d in report.in_order)),
        words=tuple(sorted(_renamed(d.message, back) for d in report.in_order)),
        numbers={_renamed(key, back): value for key, value in numbers.items()},
    )


def _settings(key: str, found: Any) -> dict[str, FloatArray]:
    rows = [
        (v.microscope.magnification, v.microscope.aperture, v.focus_um, v.light)
        for v in found
    ]
    sizes = [sorted((v.region.rows, v.region.columns)) for v in found]
    return {
        f"{key} settings": np.array(rows, dtype=float).reshape(-1, 4),
        f"{key} regions": np.array(sizes, dtype=float).reshape(-1, 2),
    }


def _faces(key: str, layers: Any, form: Form) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    for layer in layers:
        if layer.name.partition(".")[0] == "tweezers":
            continue
        name = f"{key} face {layer.name}"
        corners = np.concatenate([flatten(r, CHORD_UM) for r in layer.outline.rings])
        found[f"{name} places"] = _back(corners, form)
        found[name] = np.array([layer.z_um, layer.reflectance])
    return found


def _beliefs(key: str, state: Any, form: Form) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    for name, part in state.parts.items():
        pose = part.pose
        found[f"{key} place of {name} places"] = _back(
            np.array([[pose.x_um, pose.y_um]]), form
        )
        angle = pose.theta_rad - form.quarters * math.pi / 2
        found[f"{key} belief in {name}"] = np.array(
            [math.cos(angle), math.sin(angle), part.sigma_xy_um, part.sigma_theta_rad]
        )
    return found


def _back(points: FloatArray, form: Form) -> FloatArray:
    """Return points with the turn of the world undone."""
    return np.array([turned(x, y, -form.quarters) for x, y in points])


def _renamed(text: str, back: Mapping[str, str]) -> str:
    for new, old in back.items():
        text = text.replace(new, old)
    return text


def differences(one: Seen, other: Seen, form: Form) -> list[str]:
    """Return in what two ways of writing a task differ."""
    found = []
    if not form.quarters:
        if json.loads(one.normalised or "0") != json.loads(other.normalised or "0"):
            found.append("normalised")
        if one.words != other.words:
            found.append(f"words {set(one.words) ^ set(other.words)}")
    if one.findings != other.findings:
        found.append(f"findings {one.findings} {other.findings}")
    if one.numbers.keys() != other.numbers.keys():
        return [*found, f"names {one.numbers.keys() ^ other.numbers.keys()}"]
    for key, value in one.numbers.items():
        gap = _gap(value, other.numbers[key], ordered=not form.quarters)
        if not gap <= SAME_UM:
            found.append(f"{key} by {gap:.3g}")
    return found


def _gap(one: FloatArray, other: FloatArray, *, ordered: bool) -> float:
    """Return the largest difference; of points in any order where they were turned."""
    if one.shape != other.shape:
        return math.inf
    if not one.size:
        return 0.0
    if ordered or one.ndim < 2 or one.shape[1] != 2:
        return float(np.abs(one - other).max())
    apart = np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1))
    return float(max(apart.min(axis=0).max(), apart.min(axis=1).max()))
