"""What a plan says of its task: provenance, beliefs, places of features, inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version

from microplan.planner.assembly.assembly import State
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import Preset, Sketch
from microplan.planner.task.task import Task
from microplan.planner.views.targets import middle_um
from microplan.schemas import plan as p
from microplan.schemas.codec import to_data
from microplan.schemas.pose import Pose

PLACES = 6  # decimals of a feature, um: a picometre, as in `sweep.ROUNDING_UM`


def provenance_of(task: Task, preset: Preset | Sketch, limit: float) -> p.Provenance:
    """Return the provenance of the plan: versions, digests, seed."""
    return p.Provenance(
        microplan=version("microplan"),
        task_sha256=_digest(task.normalised),
        workcell_sha256=_digest(task.workcell.normalised),
        drawings_sha256={
            name: _digest(_part_entry(task, name)) for name in sorted(task.parts)
        },
        seed=task.seed,
        preset=preset,
        max_image_error=limit,
    )


def _part_entry(task: Task, name: str) -> Mapping[str, object]:
    """Return a part's normalised entry, its outline included."""
    parts = task.normalised["parts"]
    if not isinstance(parts, Mapping):
        raise TypeError("normalised parts must be a mapping")
    entry: Mapping[str, object] = parts[name]
    return entry


def _digest(data: object) -> str:
    """Return the sha256 of plain data, keys sorted."""
    text = json.dumps(data, sort_keys=True, default=to_data)
    return hashlib.sha256(text.encode()).hexdigest()


def beliefs_of(task: Task, start: State) -> tuple[p.Belief, ...]:
    """Return the initial pose of every part and the tool, with its uncertainty."""
    found = [
        p.Belief(
            name=name,
            carrier=part.carrier,
            pose=part.pose,
            sigma_xy_um=part.sigma_xy_um,
            sigma_theta_rad=part.sigma_theta_rad,
            z_um=task.workcell.stage.datum_z_um + part.z_um,  # all start on the stage
        )
        for name, part in sorted(start.parts.items())
    ]
    if start.tool is not None:
        found.append(
            p.Belief(
                name=start.tool,
                carrier="robot",
                pose=Pose(x_um=0.0, y_um=0.0),
                sigma_xy_um=start.tip_sigma_um,
                sigma_theta_rad=task.workcell.robot.axes.repeatability_theta_rad,
            )
        )
    return tuple(found)


def feature_places(task: Task) -> tuple[p.FeaturePlace, ...]:
    """Return the positions of named features in their owners' frames, um."""
    centers = {
        f"{part.name}.{name}": (part.name, center)
        for part in task.parts.values()
        for name, center in (
            *((f.name, f.center_um) for f in part.features.values()),
            ("outline", middle_um(part)),  # as looks at a whole part measure it
            *((post.name, post.center_um) for post in part.posts.values()),
        )
    }
    return tuple(
        p.FeaturePlace(
            name=name,
            owner=owner,
            x_um=round(center[0], PLACES),  # what sums leave below means nothing
            y_um=round(center[1], PLACES),
        )
        for name, (owner, center) in sorted(centers.items())
    )


def inputs_of(report: Report) -> dict[str, object]:
    """Return the input files and the versions of libraries; never compared."""
    names = ("microplan", "numpy", "scipy", "opencv-contrib-python-headless", "ezdxf")
    return {
        "files": dict(sorted(report.files.items())),
        "versions": {name: version(name) for name in names},
    }
