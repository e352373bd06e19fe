"""Pictures of the true world's solid bodies, by the cell's own rays and waves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.imaging_view import (
    Halo,
    ImagingView,
    LampLevel,
    PixelWindow,
)
from microplan.executor.simulated.imaging.photograph import photograph
from microplan.executor.simulated.imaging.solids.plane_outline import (
    PlaneOutline,
    read_outline,
)
from microplan.executor.simulated.imaging.solids.solid_scene import (
    SolidBody,
    SolidScene,
)
from microplan.executor.simulated.lens import SimLens
from microplan.executor.simulated.outlines.fabricated import FabricatedRing
from microplan.executor.simulated.shapes import Fabricated
from microplan.executor.simulated.truth import TrueBody, Truth
from microplan.schemas.files.world import WorldMark, WorldOutline
from microplan.schemas.pose import Pose

FILM_UM = 1e-3  # thickness of a mark: no image shows it


class SolidPictures:
    """Photographs of what truly is there."""

    def __init__(self, truth: Truth, lens: SimLens) -> None:
        self._truth, self._lens = truth, lens

    def image(
        self,
        window: PixelWindow,
        lamp: LampLevel,
        *,
        height_px: int,
        scale: float,
    ) -> FloatArray:
        """Return (rows, columns) px of a frame, shares of 1; see `camera.Pictures`."""
        view = self.view(lamp, height_px=height_px, scale=scale)
        return photograph(bodies_of(self._truth), view, window)

    def view(
        self, lamp: LampLevel, *, height_px: int, scale: float = 1.0
    ) -> ImagingView:
        """Return the present setting of lens, light and camera."""
        optics, lens = self._truth.world.optics, self._lens
        return ImagingView(
            aperture=lens.aperture,
            wavelength_um=optics.wavelength_um,
            medium_index=optics.medium_index,
            magnification=scale * lens.magnification,
            pitch_um=optics.pitch_um,
            width_px=optics.width_px,
            height_px=height_px,
            fill_factor=optics.fill_factor,
            focus_um=lens.focus_um,
            lamp_share=optics.lamp_share,
            shift_um=lens.shift_um,
            errors=lens.errors,
            lamp=lamp,
            wavefront=optics.wavefront,
            halo=Halo(radius_um=optics.halo_radius_um, share=optics.halo_share),
        )


def bodies_of(truth: Truth) -> SolidScene:
    """Return every body where it truly is, as it was made."""
    bodies = [
        solid
        for name in sorted(truth.bodies)
        for solid in _part(truth, truth.bodies[name])
    ]
    return SolidScene(
        bodies=(*_fingers(truth), *bodies),
        stage_um=truth.stage_z_um(),
        stage_reflectance=truth.world.stage_reflectance,
    )


def _part(truth: Truth, body: TrueBody) -> Iterator[SolidBody]:
    """Yield a part's prism, those of its posts, and the marks on them.

    A part that was pressed below the stage's surface by an error of its height is no
    lower than that: the camera has no way to see it.
    """
    part, stage_um = body.part, truth.stage_z_um()
    top_um = max(truth.top_um(body), stage_um)
    whole = SolidBody(
        name=part.name,
        outline=_as_made(part.outline, body.made),
        pose=truth.pose(body),
        bottom_um=min(max(truth.under_um(body), stage_um), top_um),
        top_um=top_um,
        reflectance=part.reflectance,
        finish=truth.surfaces[part.name].finish,
        wall_reflectance=truth.surfaces[part.name].wall_reflectance,
    )
    posts = [
        replace(
            whole,
            name=post.name,
            outline=_as_made(drawn.outline, post.made),
            bottom_um=top_um,
            top_um=top_um + post.height_um,
            reflectance=post.reflectance,
            finish=truth.surfaces[post.name].finish,
            wall_reflectance=truth.surfaces[post.name].wall_reflectance,
        )
        for drawn, post in zip(part.posts, body.posts, strict=True)
    ]
    for solid in (whole, *posts):
        yield solid
        yield from (_mark(mark, solid) for mark in part.marks if mark.on == solid.name)


def _mark(mark: WorldMark, solid: SolidBody) -> SolidBody:
    """Return a mark as a film on top of its body."""
    return replace(
        solid,
        name=mark.name,
        outline=read_outline(mark.outline),
        bottom_um=solid.top_um,
        top_um=solid.top_um + FILM_UM,
        reflectance=mark.reflectance,
    )


def _as_made(shape: WorldOutline, made: Fabricated) -> PlaneOutline:
    """Return a drawn outline with its fabricated rings in place of those drawn."""
    rings = []
    for i, ring in enumerate(shape.rings):
        if i not in made:
            rings.append(tuple(ring.edges))
        elif (found := made[i]) is not None:
            rings.append(_edges(found))
    return PlaneOutline(tuple(rings))


def _edges(made: FabricatedRing) -> tuple[tuple[float, ...], ...]:
    """Return a fabricated ring as edges: a whole circle, or straight ones."""
    if made.round_um is not None:
        return ((*made.center_um, made.round_um, 0.0, math.tau),)
    ends = np.hstack([made.corners_um, np.roll(made.corners_um, -1, axis=0)])
    return tuple(tuple(edge) for edge in ends.tolist())


def _fingers(truth: Truth) -> Iterator[SolidBody]:
    """Yield both fingers."""
    tool = truth.tool
    if tool is None:
        return
    grip, low_um = truth.grip_pose(), truth.grip_z_um()
    low_um = max(low_um, truth.stage_z_um())
    surface = truth.surfaces[tool.name]
    for side, name, outline in ((-1, "left", tool.left), (1, "right", tool.right)):
        aside = Pose(x_um=side * truth.opening_um / 2, y_um=0.0)
        yield SolidBody(
            name=f"{tool.name}.{name}",
            outline=read_outline(outline),
            pose=grip.compose(aside),
            bottom_um=low_um,
            top_um=low_um + tool.thickness_um,
            reflectance=tool.reflectance,
            finish=surface.finish,
            wall_reflectance=surface.wall_reflectance,
        )
