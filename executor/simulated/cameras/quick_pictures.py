"""Quick pictures: flat top faces by the compiler's own renderer.

What draws them is what they would have to judge: of images, and of what depends on
them, they show no mistake that the compiler shares.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from microplan.arrays import FloatArray
from microplan.executor.simulated.cameras.quick_outlines import outline_of
from microplan.executor.simulated.imaging.imaging_view import LampLevel, PixelWindow
from microplan.executor.simulated.lens import SimLens
from microplan.executor.simulated.truth import TrueBody, Truth
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.schemas.pose import Pose

BLUR_LAW = "stokseth"  # another defocus model than the compiler's
APERTURE_RATIO = 1.02  # and another aperture


class QuickPictures:
    """Pictures of flat top faces."""

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
        microscope, focus_um = self._microscope(height_px, scale), self._lens.focus_um
        share = self._truth.world.optics.lamp_share * microscope.aperture
        whole = (window.rows, window.columns) == (height_px, microscope.width_px)
        return render_coaxial(
            lens_scene(scene_of(self._truth), microscope, self._errors(), focus_um),
            microscope,
            focus_um=focus_um,
            lamp_aperture=share or None,
            model=BLUR_LAW,
            window=None
            if whole
            else Window(
                row=window.row,
                column=window.column,
                rows=window.rows,
                columns=window.columns,
            ),
            light=Illumination(
                gain=lamp.level,
                gradient_x=lamp.gradient_x,
                gradient_y=lamp.gradient_y,
            ),
            shift_um=self._lens.shift_um,
        )

    def _errors(self) -> LensErrors:
        """Return the lens' true errors."""
        true = self._lens.errors
        return LensErrors(
            distortion=true.distortion,
            lateral_x=true.lateral_x,
            lateral_y=true.lateral_y,
            scale_per_um=true.scale_per_um,
            field_curvature_per_um=true.field_curvature_per_um,
        )

    def _microscope(self, height_px: int, scale: float) -> Microscope:
        """Return the optical setting."""
        optics = self._truth.world.optics
        aperture = min(
            self._lens.aperture * APERTURE_RATIO, 0.999 * optics.medium_index
        )
        return Microscope(
            aperture=aperture,
            wavelength_um=optics.wavelength_um,
            medium_index=optics.medium_index,
            magnification=scale * self._lens.magnification,
            pitch_um=optics.pitch_um,
            width_px=optics.width_px,
            height_px=height_px,
            fill_factor=optics.fill_factor,
            wavefront=optics.wavefront,
            halo=(optics.halo_radius_um, optics.halo_share)
            if optics.halo_radius_um * optics.halo_share
            else None,
        )


def scene_of(truth: Truth) -> Scene:
    """Return every top face where it truly is."""
    bodies = (_layers(truth, truth.bodies[name]) for name in sorted(truth.bodies))
    layers = itertools.chain(_fingers(truth), *bodies)
    return Scene(
        layers=tuple(layers),
        background=truth.world.stage_reflectance,
        background_z_um=truth.stage_z_um(),
    )


def _layers(truth: Truth, body: TrueBody) -> Iterator[Layer]:
    """Yield a body's face, the tops of its posts, and the marks on them."""
    part, top_um = body.part, truth.top_um(body)
    faces = [
        (part.name, outline_of(part.outline, body.made), top_um, part.reflectance),
        *(
            (
                post.name,
                outline_of(drawn.outline, post.made),
                top_um + post.height_um,
                post.reflectance,
            )
            for drawn, post in zip(part.posts, body.posts, strict=True)
        ),
    ]
    for name, outline, z_um, reflectance in faces:
        marks = [m for m in part.marks if m.on == name]
        shapes = [outline_of(mark.outline) for mark in marks]
        holes = tuple(ring.reversed() for shape in shapes for ring in shape.rings)
        seen = [(name, Outline(rings=outline.rings + holes), reflectance)]
        seen += [(m.name, o, m.reflectance) for m, o in zip(marks, shapes, strict=True)]
        for shown, edges, share in seen:
            yield Layer(
                name=shown,
                outline=_at(edges, truth.pose(body)),
                z_um=z_um,
                reflectance=share,
            )


def _fingers(truth: Truth) -> Iterator[Layer]:
    """Yield the tops of both fingers."""
    tool = truth.tool
    if tool is None:
        return
    fingers = (outline_of(tool.left), outline_of(tool.right))
    grip = truth.grip_pose()
    for side, name, outline in zip((-1, 1), ("left", "right"), fingers, strict=True):
        x_um = side * truth.opening_um / 2
        yield Layer(
            name=f"{tool.name}.{name}",
            outline=_at(outline, grip.compose(Pose(x_um=x_um, y_um=0.0))),
            z_um=truth.grip_z_um() + tool.thickness_um,
            reflectance=tool.reflectance,
        )


def _at(outline: Outline, pose: Pose) -> Outline:
    """Return an outline at a pose."""
    return place(outline, pose.x_um, pose.y_um, pose.theta_rad)
