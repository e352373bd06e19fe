"""Light and coherence of a workcell file, as typed values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from microplan.optics.coherence.degree import MOST, Coherence
from microplan.planner.task.workcell import RINGS, LightSpec

INCOHERENT = "incoherent"


def read_light(raw: Mapping[str, Any]) -> LightSpec:
    """Return the light; angles in radians."""
    low, high = raw["level"]
    aperture, elevation = raw.get("aperture"), raw.get("elevation_deg")
    return LightSpec(
        kind=raw["kind"],
        level=(float(low), float(high)),
        gradient=float(raw["gradient"]),
        aperture=None if aperture is None else float(aperture),
        elevation_rad=None
        if elevation is None
        else (math.radians(elevation[0]), math.radians(elevation[1])),
    )


def read_coherence(data: Mapping[str, Any]) -> Coherence | None:
    """Return the coherence of a workcell's light, None where it is incoherent.

    Unstated it is all that the kind of light allows: of a lamp below it is known, of a
    ring directions lie beyond the objective's cone.
    """
    value = data["optics"].get("coherence")
    if value == INCOHERENT or value == 0:  # 0: in a file of version 1
        return None
    if isinstance(value, list):
        return Coherence(least=float(value[0]), most=float(value[1]))
    if value is not None:
        return Coherence(least=float(value), most=float(value))
    least, most = 0.0, 1.0
    light = data["light"]
    if light["kind"] in RINGS:
        least, most = 1.0, MOST
    elif light["kind"] == "transmitted":
        table = data["optics"]["numerical_aperture"]
        rows = [r["value"] for r in table] if isinstance(table, list) else [table]
        least, most = (
            min(light["aperture"] / each, MOST) for each in (max(rows), min(rows))
        )
    return Coherence(least=least, most=most, is_stated=False)
