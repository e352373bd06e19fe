"""Task file in, `Task` out: everything the user got wrong is reported in one go."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from microplan.planner.source.changed_values import ChangedValue, changed
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.files import named_file
from microplan.planner.source.normalise import plain, plain_lengths, plain_outline
from microplan.planner.source.schema import Checked, check, with_defaults
from microplan.planner.source.source import Source, read_source
from microplan.planner.task.check_workcell import (
    check_limits,
    check_sizes,
    check_surfaces,
    check_workcell,
    report_backwards,
)
from microplan.planner.task.light.check_light import check_light
from microplan.planner.task.light.roundings import check_roundings
from microplan.planner.task.parts import read_parts
from microplan.planner.task.read_workcell import (
    build_workcell,
    optional_float,
    places,
    read_fingers,
)
from microplan.planner.task.references import check_references
from microplan.planner.task.task import (
    Benchmark,
    Environment,
    Move,
    Optimise,
    Part,
    Reading,
    StartPose,
    Task,
    TaskStep,
    ToolStart,
)
from microplan.planner.task.workcell import Workcell
from microplan.schemas.codec import from_data

NM_PER_UM = 1e3
ANY_SIGMA_RAD = math.pi / math.sqrt(3)  # standard deviation of a uniform angle


def load_task(
    path: str | Path, report: Report, changes: Sequence[ChangedValue] = ()
) -> Task | None:
    """Return the task at `path` with its workcell and drawings.

    Parameters
    ----------
    path : str or Path
        The task file, as the user names it; findings name files relative to that.
    report : Report
        Receives the findings of all files; the task, the workcell and every drawing
        are read whatever is wrong with the others.
    changes : sequence of ChangedValue
        Values other than the files'; those below `workcell` are of the workcell file.

    Returns
    -------
    Task or None
        None if there was any error.
    """
    file = str(path)
    source = read_source(Path(path), file, report, Span(file=file))
    return None if source is None else read_task(source, report, changes)


def read_task(
    source: Source, report: Report, changes: Sequence[ChangedValue] = ()
) -> Task | None:
    """Return the task that a source holds, None if there was any error.

    As `load_task`, of what has been parsed.
    """
    here, of_cell = _by_file(changes)
    source = changed(source, here, report)
    task = check(source, "task", "microplan", report)
    cell = _workcell(task, of_cell, report)
    parts = read_parts(task, report)
    fingers = read_fingers(cell, report) if cell else {}
    if cell:
        check_workcell(cell, report)
        check_surfaces(cell, report, "tools")
        check_light(task, cell, report)
    _check_task(task, report)
    check_references(task, cell, report)
    check_limits(task, cell, report)
    if report.failed or cell is None:
        return None
    workcell = build_workcell(cell, fingers)
    check_sizes(parts, workcell, report)
    found = None if report.failed else _task(source, workcell, parts)
    return found if found is not None and check_roundings(found, report) else None


def _by_file(
    changes: Sequence[ChangedValue],
) -> tuple[Sequence[ChangedValue], Sequence[ChangedValue]]:
    """Return the changes of the task and those of its workcell file."""
    inside = [c for c in changes if c.key[0] == "workcell" and len(c.key) > 1]
    here = [change for change in changes if change not in inside]
    return here, [replace(change, key=change.key[1:]) for change in inside]


def _workcell(
    task: Checked, changes: Sequence[ChangedValue], report: Report
) -> Checked | None:
    """Return the workcell file that the task names, with some values changed."""
    if not task.good("workcell"):
        return None
    at = task.source.value("workcell")
    name = task.source.get("workcell")
    found = named_file(name, at, task.source.path.parent, report)
    if found is None:
        return None
    source = read_source(found[0], found[1], report, at)
    if source is None:
        return None
    source = changed(source, changes, report)
    return check(source, "workcell", "microplan_workcell", report)


def _check_task(task: Checked, report: Report) -> None:
    """Report intervals that run backwards."""
    check_surfaces(task, report, "parts")
    for key in ("light_gain", "light_gradient"):
        if task.good("benchmark", key):
            low, high = task.source.data["benchmark"][key]
            report_backwards(task.source, ("benchmark", key), low, high, report)


def _task(source: Source, workcell: Workcell, parts: Mapping[str, Part]) -> Task:
    """Return the typed task; nothing in it is at fault."""
    data = with_defaults(source.data, "task")
    starts = {name: raw for name, raw in data["start"].items() if name != "stage"}
    return Task(
        name=data["name"],
        seed=int(data["seed"]),
        workcell=workcell,
        parts=parts,
        stage_start=_reading(data["start"]["stage"]),
        part_starts={
            name: _start(name, raw, source.key("start", name))
            for name, raw in starts.items()
            if raw["on"] == "stage"
        },
        tool_starts={
            name: _tool_start(name, raw, source.key("start", name))
            for name, raw in starts.items()
            if raw["on"] == "robot"
        },
        success_goal=optional_float(data.get("goal", {}).get("success_probability")),
        steps=tuple(_step(source, i, raw) for i, raw in enumerate(data["steps"])),
        optimise=Optimise(
            prefer=data["optimise"]["prefer"],
            max_image_error=optional_float(data["optimise"].get("max_image_error")),
        ),
        benchmark=_benchmark(data["benchmark"]),
        environment=_environment(data["environment"]),
        where=places(source),
        normalised=_normalised(data, parts),
    )


def _normalised(data: Mapping[str, Any], parts: Mapping[str, Part]) -> dict[str, Any]:
    """Return the task as plain data: drawings as geometry, no file names."""
    out: dict[str, Any] = plain(data)
    del out["microplan"], out["workcell"]
    out["optimise"]["may_change"].sort()
    for name, part in parts.items():
        raw = out["parts"][name]
        del raw["drawing"]
        raw["outline"] = plain_outline(part.outline)
        if isinstance(raw.get("origin"), list):
            del raw["origin"]  # the outline lies about it
        for key, post in part.posts.items():
            raw["posts"][key]["outline"] = plain_outline(post.outline)
        for key, mark in part.marks.items():
            owner = raw["posts"][mark.on] if mark.on else raw
            mark_raw = owner["marks"][key.rpartition(".")[2]]
            mark_raw["outline"] = plain_outline(mark.outline)
        for key, feature in raw["features"].items():
            if {"ring", "at"} & feature.keys():
                del feature["ring" if "ring" in feature else "at"]
                meant = part.features[key]  # however it was chosen
                feature["is"] = plain_lengths(*meant.center_um, meant.radius_um)
    return out


def _start(name: str, raw: Mapping[str, Any], at: Span) -> StartPose:
    uniform = "theta" in raw
    sigma_rad = math.radians(raw.get("sigma_theta_deg", 0.0))
    return StartPose(
        name=name,
        x_um=float(raw["x_um"]),
        y_um=float(raw["y_um"]),
        theta_rad=math.radians(raw.get("theta_deg", 0.0)),
        theta_any=uniform,
        sigma_xy_um=float(raw.get("sigma_xy_um", 0.0)),
        sigma_theta_rad=ANY_SIGMA_RAD if uniform else sigma_rad,
        face=raw.get("face", "up"),
        where=at,
    )


def _tool_start(name: str, raw: Mapping[str, Any], at: Span) -> ToolStart:
    return ToolStart(
        name=name,
        x_um=float(raw["x_um"]),
        y_um=float(raw["y_um"]),
        z_um=float(raw["z_um"]),
        theta_rad=math.radians(raw.get("theta_deg", 0.0)),
        opening_um=float(raw["opening_um"]),
        where=at,
    )


def _step(source: Source, index: int, raw: Mapping[str, Any]) -> TaskStep:
    view = raw.get("view_um")
    return TaskStep(
        id=raw["id"],
        verb=raw["do"],
        target=raw.get("target"),
        to=raw.get("to"),
        tool=raw.get("with"),
        onto=raw.get("onto"),
        on=raw.get("on"),
        empty=raw.get("empty"),
        view_um=None if view is None else (float(view[0]), float(view[1])),
        move=tuple(
            _move(entry, source.value("steps", index, "move", number))
            for number, entry in enumerate(raw.get("move", ()))
        ),
        opening_um=optional_float(raw.get("opening_um")),
        method=raw.get("method", "auto"),
        tolerance_xy_um=optional_float(raw.get("tolerance_xy_um")),
        tolerance_theta_rad=_radians(raw.get("tolerance_theta_deg")),
        within_um=optional_float(raw.get("within_um")),
        within_rad=_radians(raw.get("within_deg")),
        height_within_um=optional_float(raw.get("height_within_um")),
        speed_um_per_s=optional_float(raw.get("speed_um_per_s")),
        if_blocked="if_blocked" in raw,
        where=source.value("steps", index, "id"),
        spans={key: source.value("steps", index, key) for key in sorted(raw)},
    )


def _move(raw: Mapping[str, Any], at: Span) -> Move:
    ((axes, to),) = raw.items()
    return Move(axes="stage" if axes == "stage" else "robot", to=_reading(to), where=at)


def _reading(raw: Mapping[str, Any]) -> Reading:
    return from_data(Reading, {**raw, "theta_rad": _radians(raw.get("theta_deg"))})


def _benchmark(raw: Mapping[str, Any]) -> Benchmark:
    sigma_rad = math.radians(raw["pose_sigma_theta_deg"])
    return from_data(Benchmark, {**raw, "pose_sigma_theta_rad": sigma_rad})


def _environment(raw: Mapping[str, Any]) -> Environment:
    roughness_um = raw["roughness_nm"] / NM_PER_UM
    return from_data(Environment, {**raw, "roughness_um": roughness_um})


def _radians(value: float | None) -> float | None:
    return None if value is None else math.radians(value)
