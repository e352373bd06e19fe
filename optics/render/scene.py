"""Scenes for the renderer: layers by height, background, light, window."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microplan.optics.outline.outline import Outline


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeLine:
    """Bright line that the rounded edges of a face mirror from a ring of light."""

    level: float  # share of full scale, of which a white dull face gives 1
    width_um: float  # along the axis, through a narrow pupil
    radius_um: float  # of the rounding: the line lies within so much of the edge
    rings: int  # the first ones of the outline are rounded

    def __post_init__(self) -> None:
        if not (self.level >= 0 and math.isfinite(self.level)):
            raise ValueError(f"level must be finite and >= 0, got {self.level}")
        if not 0 < self.width_um <= self.radius_um < math.inf:
            raise ValueError(
                f"width_um must be in (0, {self.radius_um}], got {self.width_um}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Layer:
    """One body: a prism of an outline, or its top face alone."""

    name: str
    outline: Outline  # in the world frame, um
    z_um: float  # world height of the top face
    reflectance: float  # share of the light that the face sends back [1]
    underside_um: float | None = None  # world height; None: a flat face without walls
    wall_reflectance: float = 0.0  # of the walls, as mirrors; 0: they are black
    finish: float = 0.0  # share of what the face sends back as a mirror
    transmittance: float = 0.0  # of light from below
    edge_line: EdgeLine | None = None  # in a ring's light

    def __post_init__(self) -> None:
        for name in ("wall_reflectance", "finish", "transmittance"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in 0..1, got {getattr(self, name)}")
        under = self.underside_um
        if under is not None and not (math.isfinite(under) and under <= self.z_um):
            raise ValueError(f"underside_um must be at most {self.z_um}, got {under}")
        if not math.isfinite(self.z_um):
            raise ValueError(f"z_um must be finite, got {self.z_um}")
        if not 0 <= self.reflectance <= 1:
            raise ValueError(f"reflectance must be in 0..1, got {self.reflectance}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Illumination:
    """Brightness of the light and its change across the field.

    Intensity is multiplied by `gain (1 + gradient_x x/W + gradient_y y/H)` with (x, y)
    in um from the optical axis and W x H the field of view, so `gradient_x` is the
    relative change from the left to the right border.
    """

    gain: float = 1.0
    gradient_x: float = 0.0
    gradient_y: float = 0.0

    def __post_init__(self) -> None:
        if not (self.gain >= 0 and math.isfinite(self.gain)):
            raise ValueError(f"gain must be finite and not negative, got {self.gain}")
        if not abs(self.gradient_x) + abs(self.gradient_y) <= 2:
            raise ValueError("the gradients must not make the light negative")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Layers over a uniform background; the order of `layers` does not matter."""

    layers: tuple[Layer, ...]
    background: float  # reflectance of the plane below everything [1]
    background_z_um: float | None = None  # its world height; None: never shaded

    def __post_init__(self) -> None:
        if not 0 <= self.background <= 1:
            raise ValueError(f"background must be in 0..1, got {self.background}")
        z_um = self.background_z_um
        if z_um is not None and not math.isfinite(z_um):
            raise ValueError(f"background_z_um must be finite, got {z_um}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """A rectangle of the camera frame, px: rows go down, (0, 0) is the top left."""

    row: int
    column: int
    rows: int
    columns: int

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise ValueError(f"a window needs at least one pixel, got {self}")

    def part(self, rows: slice, columns: slice) -> Window:
        """Return some of the window's own rows and columns as a window."""
        return Window(
            row=self.row + rows.start,
            column=self.column + columns.start,
            rows=rows.stop - rows.start,
            columns=columns.stop - columns.start,
        )
