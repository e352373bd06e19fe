"""Walls and faces of bodies: what they reflect as mirrors, stated or by material.

A wall stands nearly along the light that meets it. A lens of aperture .42 sends light
on a vertical wall at 65 to 90 degrees from its normal, where clean metal is a mirror
and a rough wall is none: unstated, it is anything between.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Interval = tuple[float, float]

# Fresnel's reflectance of smooth surfaces at 600 nm, unpolarised: the least and the
# most from 65 to 88 degrees from the normal.
GRAZING: Mapping[str, Interval] = {"nickel": (0.60, 0.88), "silicon": (0.36, 0.76)}
MOST = 0.9  # of a material that is not named


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceFinish:
    """Least and greatest reflectance of walls, and share of a face that is a mirror's.

    `stated` says which of the two the user gave: images take the middle of those; the
    rest of what is stated of a body is a black wall or a dull face there.
    """

    wall: Interval
    finish: Interval
    stated: tuple[bool, bool]
    edge_radius_um: float | None = None  # of the rounding of top edges
    transmittance: float = 0.0

    @property
    def seen_wall(self) -> float:
        """Return the reflectance of walls that images take."""
        return sum(self.wall) / 2 if self.stated[0] else 0.0

    @property
    def seen_finish(self) -> float:
        """Return the finish of the face that images take."""
        return sum(self.finish) / 2 if self.stated[1] else 0.0


def surface_finish(raw: Mapping[str, Any], material: str = "") -> SurfaceFinish:
    """Return the surface of a part, post or tool from its keys."""
    wall = raw.get("wall")
    reflectance = (0.0, GRAZING.get(material.strip().lower(), (0.0, MOST))[1])
    if wall is not None and wall["kind"] == "black":
        reflectance = (0.0, 0.0)
    elif wall is not None and "reflectance" in wall:
        reflectance = interval(wall["reflectance"])
    finish, radius_um = raw.get("finish"), raw.get("edge_radius_um")
    return SurfaceFinish(
        wall=reflectance,
        finish=(0.0, 1.0) if finish is None else interval(finish),
        stated=(wall is not None, finish is not None),
        edge_radius_um=None if radius_um is None else float(radius_um),
        transmittance=float(raw.get("transmittance", 0.0)),
    )


def interval(value: float | list[float]) -> Interval:
    """Return a number as an interval of no width."""
    ends = value if isinstance(value, list) else [value, value]
    return (float(ends[0]), float(ends[1]))
