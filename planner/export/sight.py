"""Projection of a target's edges into a look's image; which of them are visible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.sampling import WIDTHS_PX
from microplan.optics.lens.displacement import displaced_far
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.outline import Outline, Ring, place
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.shapes import polygon
from microplan.planner.export.folder import ExportedPlan, Viewed, unfit
from microplan.schemas.files.evidence import PlacedBody
from microplan.schemas.files.world import World
from microplan.schemas.plan import Look

HIGHER_UM = 1e-6  # what is less above a face is level with it
# of the frame's border: an edge filter of the widest kind must find pixels on both
# sides, or the border itself would count as an edge
MARGIN_PX = 3 * WIDTHS_PX[3]


@dataclass(frozen=True, slots=True, kw_only=True)
class LookProjection:
    """How one look sees a target: lens, frame, and what lies above it."""

    microscope: Microscope
    lens: LensErrors
    defocus_um: float  # of the target's face
    covers: tuple[BaseGeometry, ...]  # higher bodies, in the world

    def pixels(self, points: FloatArray) -> FloatArray:
        """Return where the frame shows points (N, 4), as column, row, normal.

        The normal is that in the picture, rows going down.
        """
        scope = self.microscope
        seen = displaced_far(
            points[:, :2], self.lens, scope, defocus_um=self.defocus_um
        )
        return np.column_stack(
            (
                (scope.width_px - 1) / 2 + scope.px_per_um * seen[:, 0],
                (scope.height_px - 1) / 2 - scope.px_per_um * seen[:, 1],
                points[:, 2],
                -points[:, 3],
            )
        )

    def covered(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 4), um, lie below a higher body, (N,) bool."""
        found = np.zeros(len(points), dtype=np.bool_)
        for cover in self.covers:
            found |= shapely.contains_xy(cover, points[:, 0], points[:, 1])
        return found

    def framed(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 4), um, the frame shows with a margin, (N,) bool."""
        scope, where = self.microscope, self.pixels(points)
        column, row = where[:, 0], where[:, 1]
        low, right = MARGIN_PX, scope.width_px - 1 - MARGIN_PX
        bottom = scope.height_px - 1 - MARGIN_PX
        found: BoolArray = (
            (column >= low) & (column <= right) & (row >= low) & (row <= bottom)
        )
        return found


def sight_of(folder: ExportedPlan, viewed: Viewed) -> LookProjection:
    """Return how a look sees its target.

    Raises
    ------
    ExportError
        MP721 if the folder's files do not fit each other.
    """
    lens, names = folder.world.optics.lens, viewed.scene.target.bodies
    top_um = max((body_of(folder, viewed, name).z_um for name in names), default=0.0)
    try:
        return LookProjection(
            microscope=microscope(folder, viewed),
            lens=LensErrors(
                distortion=lens.distortion,
                lateral_x=lens.lateral_um_per_um[0],
                lateral_y=lens.lateral_um_per_um[1],
                scale_per_um=lens.scale_per_um,
            ),
            defocus_um=top_um - viewed.look.view.focus_um,
            covers=tuple(_covers(folder, viewed, top_um)),
        )
    except (ValueError, shapely.errors.GEOSException) as error:
        file = folder.path / "world.json"
        raise unfit(f"{file}: {error}", file) from error


def _covers(
    folder: ExportedPlan, viewed: Viewed, top_um: float
) -> Iterator[BaseGeometry]:
    """Yield what lies above the target."""
    for body in viewed.scene.bodies:
        if (
            body.z_um > top_um + HIGHER_UM
            and body.name not in viewed.scene.target.bodies
        ):
            outline, at = _outline(folder, body.name), body.pose
            cover = polygon(place(outline, at.x_um, at.y_um, at.theta_rad))
            shapely.prepare(cover)
            yield cover


def target_rings(folder: ExportedPlan, viewed: Viewed) -> list[tuple[str, Ring]]:
    """Return the rings of a look's target in the world, with the bodies' names."""
    target = viewed.scene.target
    found = []
    for name in target.bodies:
        pose = body_of(folder, viewed, name).pose
        outline = _outline(folder, name)
        rings: Sequence[Ring] = place(
            outline, pose.x_um, pose.y_um, pose.theta_rad
        ).rings
        if target.ring is not None:
            rings = rings[target.ring : target.ring + 1]
        found += [(name, ring) for ring in rings]
    if not found:
        file = folder.path / "scenes.json"
        raise unfit(f"{file}: {target.name!r} has no edges", file)
    return found


def microscope(folder: ExportedPlan, viewed: Viewed) -> Microscope:
    """Return the microscope as a look sets it.

    Raises
    ------
    ExportError
        MP721 if the world's numbers make none.
    """
    optics, look = folder.world.optics, viewed.look
    try:
        return Microscope(
            aperture=_aperture(folder.world, look),
            wavelength_um=optics.wavelength_um,
            medium_index=optics.medium_index,
            magnification=look.view.magnification,
            pitch_um=optics.pitch_um,
            width_px=optics.width_px,
            height_px=optics.height_px,
            fill_factor=optics.fill_factor,
        )
    except ValueError as error:
        file = folder.path / "world.json"
        raise unfit(f"{file}: {error}", file) from error


def _aperture(world: World, look: Look) -> float:
    """Return the numerical aperture of a look; ValueError if it is not stated.

    What the plan says; an older plan says nothing, then on a line between those that
    the cell states, on logarithmic scales.
    """
    rows = () if look.verdict is None else look.verdict.apertures
    for row in rows:
        if row.chosen:
            return row.aperture
    if not world.optics.apertures:
        raise ValueError("no numerical aperture is stated")
    stated = sorted(world.optics.apertures)
    zooms = [math.log(zoom) for zoom, _ in stated]
    apertures = [math.log(aperture) for _, aperture in stated]
    at = math.log(look.view.magnification)
    return math.exp(float(np.interp(at, zooms, apertures)))


def body_of(folder: ExportedPlan, viewed: Viewed, name: str) -> PlacedBody:
    """Return a body of a look's scene by its name; MP721 if there is none."""
    for body in viewed.scene.bodies:
        if body.name == name:
            return body
    file = folder.path / "scenes.json"
    raise unfit(f"{file}: look {viewed.look.id!r} has no {name!r}", file)


def _outline(folder: ExportedPlan, name: str) -> Outline:
    """Return a body's outline in its own frame; MP721 if the world has none."""
    if name not in folder.outlines:
        file = folder.path / "world.json"
        raise unfit(f"{file} has no outline of {name!r}", file)
    return folder.outlines[name]
