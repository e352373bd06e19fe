"""Bodies for tests of the imaging: the same for the camera and for plain rays."""

from __future__ import annotations

import math
from collections.abc import Sequence

from microplan.executor.simulated.imaging.imaging_view import ImagingView
from microplan.executor.simulated.imaging.solids.plane_outline import PlaneOutline
from microplan.executor.simulated.imaging.solids.solid_scene import (
    SolidBody,
    SolidScene,
)
from microplan.schemas.pose import Pose
from tests.executor.simulated.imaging.plain_rays import Prism

APERTURE, WAVELENGTH_UM, STAGE = 0.42, 0.6, 0.15
Ring = tuple[float, float, float] | tuple[tuple[float, float], ...]


def circle(x: float, y: float, radius: float) -> tuple[float, float, float]:
    """Return a circle as a ring."""
    return (float(x), float(y), float(radius))


def box(x0: float, y0: float, x1: float, y1: float) -> tuple[tuple[float, float], ...]:
    """Return a rectangle as a ring."""
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def outline(rings: Sequence[Ring]) -> PlaneOutline:
    """Return the camera's outline of rings."""
    made: list[tuple[tuple[float, ...], ...]] = []
    for ring in rings:
        if isinstance(ring[0], float):
            made.append(((*_numbers(ring), 0.0, 2 * math.pi),))
        else:
            corners = [_numbers(corner) for corner in ring]
            ends = (*corners[1:], corners[0])
            made.append(tuple((*a, *b) for a, b in zip(corners, ends, strict=True)))
    return PlaneOutline(tuple(made))


def _numbers(found: object) -> tuple[float, ...]:
    """Return a tuple of numbers as what it is."""
    assert isinstance(found, tuple)
    return found


def body(
    rings: Sequence[Ring],
    low: float,
    high: float,
    reflectance: float = 0.8,
    *,
    wall: float = 0.0,
    finish: float = 0.0,
    pose: Pose | None = None,
) -> SolidBody:
    """Return a body of the camera."""
    return SolidBody(
        name="body",
        outline=outline(rings),
        pose=pose or Pose(x_um=0.0, y_um=0.0),
        bottom_um=low,
        top_um=high,
        reflectance=reflectance,
        finish=finish,
        wall_reflectance=wall,
    )


def scene(*bodies: SolidBody, stage: float = STAGE) -> SolidScene:
    """Return bodies over a stage at height 0."""
    return SolidScene(bodies=bodies, stage_um=0.0, stage_reflectance=stage)


def twin(found: SolidBody, rings: Sequence[Ring]) -> Prism:
    """Return a body of plain rays."""
    return Prism(
        rings=tuple(rings),
        low=found.bottom_um,
        high=found.top_um,
        reflectance=found.reflectance,
        wall=found.wall_reflectance,
        finish=found.finish,
    )


def view(
    magnification: float, focus_um: float, *, lamp: float = 1.0, fill: float = 1.0
) -> ImagingView:
    """Return the microscope of the gear example."""
    return ImagingView(
        aperture=APERTURE,
        wavelength_um=WAVELENGTH_UM,
        magnification=magnification,
        pitch_um=7.5,
        width_px=640,
        height_px=480,
        fill_factor=fill,
        focus_um=focus_um,
        lamp_share=lamp,
    )
