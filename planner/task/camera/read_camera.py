"""Camera section in, `CameraSpec` out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from microplan.optics.lens.response import Response, power_rows
from microplan.planner.task.workcell import CameraSpec
from microplan.schemas.codec import from_data

STRAIGHT = ((0.0, 0.0), (1.0, 1.0))  # light and level in proportion
OF_RESPONSE = ("response", "black_level", "white_level")


def read_camera(raw: Mapping[str, Any]) -> CameraSpec:
    """Return the camera that a section describes, checked and with its defaults."""
    columns, rows = raw["pixels"]
    pattern = raw.get("pattern") or {}
    found = from_data(
        CameraSpec,
        {
            **raw,
            "latency_frames": int(raw["latency_frames"]),
            "bits": int(raw["bits"]),
            "width_px": int(columns),
            "height_px": int(rows),
            "pitch_um": raw["sensor_um"][0] / columns,
            "response": None,
            "is_response_stated": raw.get("response") is not None,
            "noise": raw.get("noise_table") or [],
            "pattern_gain": pattern.get("gain", 0.0),
            "pattern_counts": pattern.get("offset_counts", 0.0),
        },
    )
    return replace(found, response=_response(raw, 2**found.bits - 1))


def _response(raw: Mapping[str, Any], top: int) -> Response | None:
    """Return the response that a section states, None of none."""
    if all(raw.get(key) is None for key in OF_RESPONSE):
        return None
    stated = raw.get("response")
    rows = STRAIGHT if stated is None else stated
    if isinstance(rows, int | float):
        rows = STRAIGHT if rows == 1 else power_rows(float(rows))
    black, white = raw.get("black_level"), raw.get("white_level")
    if black is white is None and rows == STRAIGHT:
        return None
    return Response.from_levels(
        tuple((float(light), float(level)) for light, level in rows),
        black=0.0 if black is None else float(black),
        white=float(top) if white is None else float(white),
    )
