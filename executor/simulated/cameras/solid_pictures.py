"""Pictures of the true world's solid bodies, by the cell's own rays and waves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts
from microplan.executor.simulated.imaging.electrons import counted
from microplan.executor.simulated.imaging.imaging_view import (
    ImagingView,
    LampLevel,
    PixelWindow,
)
from microplan.executor.simulated.imaging.photograph import photograph
from microplan.executor.simulated.imaging.solids.plane_outline import (
    PlaneOutline,
    grown_rings,
    read_outline,
)
from microplan.executor.simulated.imaging.solids.solid_scene import (
    SolidBody,
    SolidScene,
)
from microplan.executor.simulated.lens import SimLens
from microplan.executor.simulated.truth import TrueBody, TruePost, Truth
from microplan.schemas.files.world import WorldPost
from microplan.schemas.pose import Pose


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
        """Return a part of a frame; see `camera.Pictures`."""
        optics, lens = self._truth.world.optics, self._lens
        view = ImagingView(
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
        )
        return photograph(bodies_of(self._truth), view, window)

    def counts(self, image: FloatArray, rng: np.random.Generator) -> Counts:
        """Return what the sensor makes of a picture."""
        optics = self._truth.world.optics
        return counted(
            image,
            full_well_e=optics.full_well_e,
            read_noise_e=optics.read_noise_e,
            bits=optics.bits,
            rng=rng,
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
    """Yield a part's prism and those of its posts.

    A part that was pressed below the stage's surface by an error of its height is no
    lower than that: the camera has no way to see it.
    """
    part, stage_um = body.part, truth.stage_z_um()
    pose, top_um = truth.pose(body), max(truth.top_um(body), stage_um)
    surface = truth.surfaces[part.name]
    holes = [
        (
            hole.center_um,
            hole.radius_um,
            body.hole_radius_um[hole.name] - hole.radius_um,
        )
        for hole in part.holes
    ]
    yield SolidBody(
        name=part.name,
        outline=grown_rings(read_outline(part.outline), holes),
        pose=pose,
        bottom_um=min(max(truth.under_um(body), stage_um), top_um),
        top_um=top_um,
        reflectance=part.reflectance,
        finish=surface.finish,
        wall_reflectance=surface.wall_reflectance,
    )
    for drawn, post in zip(part.posts, body.posts, strict=True):
        surface = truth.surfaces[post.name]
        yield SolidBody(
            name=post.name,
            outline=_post_outline(drawn, post),
            pose=pose,
            bottom_um=top_um,
            top_um=top_um + post.height_um,
            reflectance=post.reflectance,
            finish=surface.finish,
            wall_reflectance=surface.wall_reflectance,
        )


def _post_outline(drawn: WorldPost, post: TruePost) -> PlaneOutline:
    """Return a post's outline as it was made: scaled about its middle."""
    offset = post.radius_um - drawn.radius_um
    return read_outline(drawn.outline).scaled(
        drawn.center_um, 1 + offset / drawn.radius_um
    )


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
