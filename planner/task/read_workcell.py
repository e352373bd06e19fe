"""Workcell file in, `Workcell` out: units converted, contradictions reported."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from microplan.optics.coherence.degree import Coherence
from microplan.optics.lens.lens import LensErrors
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.normalise import plain, plain_outline
from microplan.planner.source.schema import Checked, with_defaults
from microplan.planner.source.source import Source
from microplan.planner.task.camera.read_camera import read_camera
from microplan.planner.task.check_workcell import check_fingers
from microplan.planner.task.drawings import DrawingSheet, open_named, take
from microplan.planner.task.finishes import interval, surface_finish
from microplan.planner.task.lens.read_wavefront import read_wavefront
from microplan.planner.task.light.read_light import read_coherence, read_light
from microplan.planner.task.workcell import (
    DiscrepancyShares,
    Focus,
    HaloSpec,
    Interval,
    Optics,
    Robot,
    Servo,
    Stage,
    Tool,
    Workcell,
    Zoom,
)
from microplan.schemas.codec import from_data

# a stated repeatability over one standard deviation; a uniform range of half-width r
# has the standard deviation r / sqrt(3)
COVERAGE = {"1sigma": 1.0, "3sigma": 3.0, "range": math.sqrt(3.0)}

RAD_PER_ARCSEC = math.pi / 180 / 3600
UM_PER_MM = 1000.0
Fingers = Mapping[str, DrawingSheet]  # by tool; of a left and a right one
Rows = tuple[tuple[float, float], ...]


def read_fingers(cell: Checked, report: Report) -> dict[str, DrawingSheet]:
    """Return the fingers, left and right, of every tool that can be read."""
    tools = cell.source.mapping("tools")
    found: dict[str, DrawingSheet] = {}
    for name in sorted(tools):
        if not cell.good("tools", name, "drawing"):
            continue
        at = cell.source.value("tools", name, "drawing", "layers")
        layers = tools[name]["drawing"]["layers"]
        if len(layers) != 2:
            message = (
                f"{name} has {len(layers)} layers, its left and right finger are 2"
            )
            report.error("MP223", at, message, "layers: [FINGER_L, FINGER_R]")
            continue
        drawing = open_named(cell, "tools", name, "drawing", report=report)
        if drawing is None:
            continue
        left, right = (take(drawing, [layer], report) for layer in layers)
        if left is None or right is None:
            continue
        found[name] = DrawingSheet(drawing=drawing, takes=(left, right))
        if cell.good("tools", name):
            outlines = left.outline, right.outline
            check_fingers(name, tools[name], *outlines, at, report)
    return found


def build_workcell(cell: Checked, fingers: Fingers) -> Workcell:
    """Return the workcell; `cell` and every finger are free of errors."""
    data = with_defaults(cell.source.data, "workcell")
    source = cell.source
    normalised = plain(data)
    del normalised["microplan_workcell"]
    normalised.pop("calibrated", None)  # where values come from changes none
    tools = {}
    for name, raw in data["tools"].items():
        tools[name] = _tool(name, raw, fingers[name], source.key("tools", name))
        left, right = (taken.outline for taken in fingers[name].takes)
        del normalised["tools"][name]["drawing"]
        normalised["tools"][name]["left"] = plain_outline(left)
        normalised["tools"][name]["right"] = plain_outline(right)
    axes, stage = data["axes"], data["axes"]["stage"]
    return Workcell(
        name=data["name"],
        optics=_optics(data["optics"], read_coherence(data)),
        camera=read_camera(data["camera"]),
        light=read_light(data["light"]),
        stage=from_data(
            Stage,
            {
                **stage,
                "axes": _axes(stage),
                "axis_tilt_sigma_rad": stage["axis_tilt_sigma_mrad"] / 1000,
                "finish": list(interval(stage["finish"]))
                if "finish" in stage
                else None,
            },
        ),
        robot=from_data(Robot, {**axes["robot"], "axes": _axes(axes["robot"])}),
        tools=tools,
        servo=from_data(Servo, data["servo"]),
        discrepancy=from_data(
            DiscrepancyShares,
            {**data["discrepancy"], "is_stated": "discrepancy" in source.data},
        ),
        normalised=normalised,
    )


def places(source: Source) -> dict[str, Span]:
    """Return the file position of every named value, by dotted name."""
    found = {}
    for where, span in source.values.items():
        if where and all(isinstance(key, str) for key in where):
            key = source.key(*where)
            section = (key.line, key.column) != (span.line, span.column) and (
                span.line > key.line
            )
            found[".".join(map(str, where))] = key if section else span
    return found


def _optics(raw: Mapping[str, Any], coherence: Coherence | None) -> Optics:
    low, high = raw["magnification"]["min"], raw["magnification"]["max"]
    table = raw["numerical_aperture"]
    if not isinstance(table, list):
        table = [{"magnification": low, "value": table}]
    apertures = tuple((float(r["magnification"]), float(r["value"])) for r in table)
    return Optics(
        magnification=(float(low), float(high)),
        apertures=apertures,
        wavelength_um=float(raw["wavelength_um"]),
        medium_index=float(raw["medium_index"]),
        coherence=coherence,
        zoom=from_data(Zoom, raw["zoom"]),
        focus=from_data(Focus, raw["focus"]),
        lens=_lens(raw, _held(apertures, float(low), float(high))),
        wavefront=read_wavefront(raw),
        halo=from_data(HaloSpec, raw["halo"]) if "halo" in raw else None,
    )


def _held(rows: Rows, low: float, high: float) -> Rows:
    """Return a table of apertures for all zooms: its ends' values hold beyond it."""
    (first, start), (last, end) = rows[0], rows[-1]
    below = ((low, start),) if low < first else ()
    above = ((high, end),) if high > last else ()
    return rows if len(rows) == 1 else (*below, *rows, *above)


def _lens(raw: Mapping[str, Any], apertures: Rows) -> LensErrors:
    """Return the errors of the lens that the file states."""
    focus = raw["focus"]
    x, y = focus["lateral_um_per_um"]
    curvature, sigma = (
        raw[f"field_curvature{kind}_per_mm"] / UM_PER_MM for kind in ("", "_sigma")
    )
    return LensErrors(
        distortion=float(raw["distortion"]),
        distortion_sigma=float(raw["distortion_sigma"]),
        lateral_x=float(x),
        lateral_y=float(y),
        lateral_sigma=float(focus["lateral_sigma_um_per_um"]),
        scale_per_um=float(focus["scale_per_um"]),
        scale_sigma_per_um=float(focus["scale_sigma_per_um"]),
        field_curvature_per_um=curvature,
        field_curvature_sigma_per_um=sigma,
        apertures=apertures if len(apertures) > 1 else (),
    )


def _axes(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of axes, repeatabilities as one standard deviation."""
    over = COVERAGE[raw["coverage"]]
    speed, limits = raw["speed"], raw["limits"]
    theta_rad = raw["repeatability_theta_arcsec"] * RAD_PER_ARCSEC
    return {
        "repeatability_xy_um": raw["repeatability_xy_um"] / over,
        "repeatability_z_um": raw["repeatability_z_um"] / over,
        "repeatability_theta_rad": theta_rad / over,
        "limits": {
            **{key: limits[key] for key in ("x_um", "y_um", "z_um")},
            "theta_rad": [math.radians(end) for end in limits["theta_deg"]],
        },
        "speed_xy_um_per_s": speed["xy_um_per_s"],
        "speed_z_um_per_s": speed["z_um_per_s"],
        "speed_theta_rad_per_s": math.radians(speed["theta_deg_per_s"]),
        "settle_s": speed["settle_s"],
    }


def _tool(name: str, raw: Mapping[str, Any], fingers: DrawingSheet, at: Span) -> Tool:
    left, right = (taken.outline for taken in fingers.takes)
    return Tool(
        name=name,
        left=left,
        right=right,
        thickness_um=float(raw["thickness_um"]),
        finger_width_um=float(raw["finger_width_um"]),
        length_um=float(raw["length_um"]),
        opening_um=_pair(raw["opening_um"]),
        grip_from_tip_um=float(raw["grip_from_tip_um"]),
        reflectance=float(raw["reflectance"]),
        surface=surface_finish(raw),
        stick_probability=float(raw["stick_probability"]),
        free_length_um=optional_float(raw.get("free_length_um")),
        youngs_modulus_gpa=optional_float(raw.get("youngs_modulus_gpa")),
        sheet=fingers,
        where=at,
    )


def _pair(values: list[float]) -> Interval:
    return (float(values[0]), float(values[1]))


def optional_float(value: float | None) -> float | None:
    """Return a number as a float, None for a key that is left out."""
    return None if value is None else float(value)
