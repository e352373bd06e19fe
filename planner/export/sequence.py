"""A plan's looks as a sequence of views: useq-schema's MDASequence."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import yaml

from microplan.planner.export.folder import ExportedPlan, Viewed
from microplan.planner.export.sight import microscope
from microplan.schemas.codec import to_data
from microplan.schemas.files.evidence import LookScene

MOST_PLANES = 25  # of a focus stack
LEAST_PLANES = 3
# of the depth of field between two planes: a stack as fine as microscopists make it
_SHARE = 0.5


def sequence(folder: ExportedPlan, *, channel: str | None = None) -> dict[str, Any]:
    """Return the looks as an MDASequence, as plain data.

    Each look is a position: x and y are the stage's readings, z is the focus, as the
    plan has them. Its own sequence is a focus stack over the range in which the look
    still meets its tolerance, the plan's focus included.

    Parameters
    ----------
    folder : ExportedPlan
        The plan.
    channel : str, optional
        Preset of the group "Channel" that is set for all; None: as it is.
    """
    data: dict[str, Any] = {
        "metadata": {
            "microplan": {
                "plan": folder.plan.name,
                "status": folder.plan.status,
                "simulated": True,
            }
        },
        "axis_order": ["p", "c", "z"],
        "stage_positions": [_position(folder, viewed) for viewed in folder.looks],
    }
    if channel is not None:
        data["channels"] = [{"config": channel}]
    return data


def sequence_json(data: dict[str, Any]) -> bytes:
    """Return a sequence as JSON."""
    return (json.dumps(data, indent=2) + "\n").encode()


def sequence_yaml(data: dict[str, Any]) -> bytes:
    """Return a sequence as YAML, keys in their order."""
    text: str = yaml.safe_dump(data, sort_keys=False, default_flow_style=None)
    return text.encode("ascii")


def planes_um(low_um: float, high_um: float, depth_um: float) -> list[float]:
    """Return the planes of a focus stack over an interval that holds 0.

    Parameters
    ----------
    low_um, high_um : float
        Ends of the range, from the plan's focus; 0 is taken in if it lies outside.
    depth_um : float
        Depth of field, from end to end; > 0.

    Returns
    -------
    list of float
        Rising, 0 among them, at most half a depth of field apart unless that makes
        more than `MOST_PLANES`.
    """
    low, high = min(low_um, 0.0), max(high_um, 0.0)
    step = max(_SHARE * depth_um, (high - low) / (MOST_PLANES - LEAST_PLANES))
    below = math.ceil(-low / step - 1e-9)
    above = math.ceil(high / step - 1e-9)
    found = [
        *(np.linspace(low, 0.0, below + 1)[:-1].tolist() if below else []),
        0.0,
        *(np.linspace(0.0, high, above + 1)[1:].tolist() if above else []),
    ]
    return [round(z, 6) + 0.0 for z in found]


def _position(folder: ExportedPlan, viewed: Viewed) -> dict[str, Any]:
    """Return one look as a position with its own focus stack."""
    look, stage = viewed.look, viewed.scene.stage
    depth_um = microscope(folder, viewed).wave_depth_um
    return {
        "name": look.id,
        "x": stage.x_um,
        "y": stage.y_um,
        "z": look.view.focus_um,
        "sequence": {
            "metadata": {"microplan": _notes(viewed)},
            "z_plan": {
                "relative": planes_um(*look.measure.usable_focus_um, depth_um),
            },
        },
    }


def _notes(viewed: Viewed) -> dict[str, Any]:
    """Return which look a position is, and what a sequence has no place for."""
    look = viewed.look
    notes = {
        "look": look.id,
        "step": viewed.step.id,
        "target": viewed.scene.target.name,
        "magnification": look.view.magnification,
        "um_per_px": look.view.um_per_px,
        "light": look.view.light,
        "focus_um": look.view.focus_um,
        "usable_focus_um": list(look.measure.usable_focus_um),
        "image": look.scene.image,
        **_elsewhere(viewed.scene),
    }
    found: dict[str, Any] = to_data(notes)
    return found


def _elsewhere(scene: LookScene) -> dict[str, Any]:
    """Return where the plan has what a sequence of stage and focus does not move."""
    found: dict[str, Any] = {
        "stage_z_um": scene.stage.z_um,
        "stage_theta_rad": scene.stage.theta_rad,
    }
    if scene.robot is not None:
        robot = {
            name: getattr(scene.robot, name)
            for name in ("x_um", "y_um", "z_um", "theta_rad")
        }
        found |= {"robot": robot, "opening_um": scene.opening_um}
    return found
