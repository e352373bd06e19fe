"""Shaded faces in an image, blurred together with the light on them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray
from microplan.optics.layers.coaxial_light import (
    Irradiance,
    area_um,
    fine_um,
    pixel_axes_um,
)
from microplan.optics.layers.joint.joint_faces import JointFace, laid
from microplan.optics.layers.joint.joint_light import LightChange, share_on
from microplan.optics.layers.joint.joint_occlusion import (
    WIDEST,
    joint_residual,
    met_lattice,
    ray_count,
)
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.layers.mirrors.images import Images, image_faces
from microplan.optics.layers.near_edges import partly_covered, points_about
from microplan.optics.layers.rays import extent
from microplan.optics.render.render import Covered
from microplan.optics.render.scene import Scene, Window
from microplan.optics.transfer.microscope import Microscope

# Points of the rays' lattice: this many in the blur's radius of what hides, and of what
# is shaded, where 64 rays lie no closer; `benchmarks/optics/shading.py` measures what
# they leave.
_HIDING, _SHADED = 3, 8
_STEPS = 4  # an octave of distances between points
# What is blurred by less than so many of the finest points' distances is near focus:
# taken as sharp, and about its edges on the finest points.
_NEAR = 4.5
# times closer are points about edges near focus: of all rays, and of trials' images
_FINER, _LESS = 2.0, 1.0
_SHARP = 0.02  # of that distance: a blur that images do not show


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadedFace:
    """A height that is shaded: the light on it, and how it is seen."""

    light: Irradiance
    changes: tuple[LightChange, ...]  # of the product of its shades
    lattice: Lattice
    share: FloatArray  # of the light, at the points of the lattice
    blurred: FloatArray  # the same blurred, and averaged over pixels
    seen: FloatArray  # that at the pixels
    # of higher layers, and what they leave of a mirror's light at the pixels
    images: Images = ()
    mirrored: FloatArray | None = None

    def on(self, lattice: Lattice) -> FloatArray:
        """Return the share of the light at another lattice, (rows, columns), 0..1."""
        return share_on(self.light, self.changes, lattice)


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadedView:
    """What an image depends on but its layers and their light."""

    microscope: Microscope
    focus_um: float
    model: str
    frame: Window
    shift_um: tuple[float, float]
    # as in `microplan.optics.render.sampling.Sampling`
    rays: float = 1.0
    walls: float | None = None
    few_points: bool = False

    def face(self, light: Irradiance, changes: Sequence[LightChange]) -> ShadedFace:
        """Return how a height is seen that has at least one shade."""
        m, z_um = self.microscope, light.z_um - self.focus_um
        area = area_um(m, self.frame, self.shift_um, z_um)
        lattice = Lattice.over(area, light.step_um)
        share = share_on(light, changes, lattice)
        blurred = blur(share, lattice.step_um, m, self.model, z_um)
        seen = self.at_pixels(blurred, lattice)
        return ShadedFace(
            light=light,
            changes=tuple(changes),
            lattice=lattice,
            share=share,
            blurred=blurred,
            seen=seen,
        )

    def lit(self, covered: Covered, face: ShadedFace) -> FloatArray:
        """Return a layer blurred with the light on it, (rows, columns), 0..1.

        The finish is the share that is dimmed by mirror images of higher layers in
        place of shades.
        """
        found = self._dull(covered, face)
        finish = covered.layer.finish
        if finish == 0 or face.mirrored is None:
            return found
        return (1 - finish) * found + finish * covered.coverage * face.mirrored

    def _dull(self, covered: Covered, face: ShadedFace) -> FloatArray:
        """Return a dull layer blurred with the light on it, (rows, columns), 0..1.

        The blur of the product is that of each multiplied, and on the lattice what it
        differs by, if the light changes within what a pixel or the lens resolves. Of
        faces far out of focus `residual` has that.
        """
        found = covered.coverage * face.seen
        if not self._is_thin(face.light):
            return found
        step = face.lattice.step_um
        inside = face.lattice.cells(covered.layer)
        z_um = face.light.z_um - self.focus_um
        both, alone = blur(
            np.stack([inside * face.share, inside]),
            step,
            self.microscope,
            self.model,
            z_um,
        )
        found += self.at_pixels(both - alone * face.blurred, face.lattice)
        return found

    def residual(
        self,
        scene: Scene,
        covered: Sequence[Covered],
        shaded: Mapping[float, ShadedFace],
    ) -> FloatArray | None:
        """Return the residual of blending layers, (rows, columns), None for none.

        Share of full scale, at the pixels. What lies near focus is taken as sharp
        first, then on the finest points about its edges.
        """
        seen = [c for c in covered if c.coverage.any()]
        fine = 2 * fine_um(self.microscope)
        change = self.blending_residual(scene, seen, shaded, _NEAR * fine)
        reach = [self.reach_um(c.layer.z_um) for c in seen]
        near = [
            c.coverage
            for c, r in zip(seen, reach, strict=True)
            if _SHARP * fine < r <= _NEAR * fine
        ]
        edges = partly_covered(near)
        part = None if edges is None else extent(edges > 0)
        if edges is None or part is None:
            return change
        cut = [replace(c, coverage=c.coverage[part]) for c in seen]
        about = replace(self, frame=self.frame.part(*part))
        closer, where = (_FINER, None) if self.rays >= 1 else (_LESS, edges[part] > 0)
        finer = about.blending_residual(
            scene, cut, shaded, _SHARP * fine, closer, where
        )
        if finer is None and change is None:
            return None
        coarse = np.zeros(edges.shape) if change is None else change
        coarse *= 1 - edges
        if finer is not None:
            coarse[part] += edges[part] * finer
        return coarse

    def blending_residual(
        self,
        scene: Scene,
        seen: Sequence[Covered],
        shaded: Mapping[float, ShadedFace],
        sharp_um: float,
        finer: float = 1.0,
        where: BoolArray | None = None,
    ) -> FloatArray | None:
        """Return the residual if faces blurred by up to `sharp_um` hide sharply.

        (rows, columns), share of full scale; None where there is none. Points are so
        many times `finer`. `where` it is wanted, (rows, columns): by default all over.
        """
        faces, lattice = self.joint_faces(scene, seen, shaded, sharp_um, finer)
        m, wanted = self.microscope, None
        if where is not None:
            wanted = points_about(where, lattice, m, self.frame, self.shift_um)
        rays = ray_count(lattice, self.rays)
        found = joint_residual(faces, lattice, m, rays=rays, wanted=wanted)
        if found is None:
            return None
        change = self.at_pixels(found.below, lattice)
        sharp = [
            group
            for group in _by_height(seen)
            if self.reach_um(group[0].layer.z_um) <= sharp_um
        ]
        for group, light in zip(sharp, found.sharp, strict=True):
            leaves = self.at_pixels(light, lattice)
            hidden = np.sum([c.coverage for c in group], axis=0)
            sent = np.sum([c.layer.reflectance * c.coverage for c in group], axis=0)
            change = change * (1 - hidden) + sent * leaves
        return change + self.at_pixels(found.above, lattice)

    def joint_faces(
        self,
        scene: Scene,
        seen: Sequence[Covered],
        shaded: Mapping[float, ShadedFace],
        sharp_um: float,
        finer: float = 1.0,
    ) -> tuple[list[JointFace], Lattice]:
        """Return a scene's faces, the lowest first, and the points rays come from."""
        groups = _by_height(seen)
        heights = [group[0].layer.z_um for group in groups]
        lit = list(shaded.values())
        images = [image[0].z_um for face in lit for image in face.images]
        lattice = self._lattice([*heights, *images], lit, sharp_um, finer)
        faces = [] if scene.background == 0 else [self._plane(scene, shaded, lattice)]
        faces += [self._joint(g, shaded, lattice, sharp_um) for g in groups]
        return faces, lattice

    def _plane(
        self, scene: Scene, shaded: Mapping[float, ShadedFace], lattice: Lattice
    ) -> JointFace:
        """Return the plane below everything."""
        height_um = scene.background_z_um
        light, points, z_um = None, lattice, 0.0
        if height_um is not None and height_um in shaded:
            z_um = height_um - self.focus_um
            points = self._met(lattice, z_um, shaded[height_um])
            light = shaded[height_um].on(points).astype(np.float32)
        covers, sends = (
            np.full(points.shape, each, dtype=np.float32)
            for each in (1.0, scene.background)
        )
        return JointFace(
            z_um=z_um, lattice=points, covers=covers, sends=sends, light=light
        )

    def _joint(
        self,
        group: Sequence[Covered],
        shaded: Mapping[float, ShadedFace],
        lattice: Lattice,
        sharp_um: float,
    ) -> JointFace:
        """Return the layers of one height and finish where rays meet them."""
        height_um, finish = group[0].layer.z_um, group[0].layer.finish
        z_um = height_um - self.focus_um
        points = self._met(lattice, z_um, shaded.get(height_um))
        is_sharp = self.reach_um(height_um) <= sharp_um
        covers, sends = laid(
            [] if is_sharp else [c.layer for c in group], points, self.rays
        )
        light: Float32Array | None = None
        thin = False
        images: tuple[JointFace, ...] = ()
        if height_um in shaded:
            face = shaded[height_um]
            light = face.on(points).astype(np.float32)
            thin = self._is_thin(face.light)
            if finish > 0:
                rays = ray_count(lattice, self.rays)
                images = image_faces(
                    face.images,
                    lattice,
                    self.microscope,
                    self.focus_um,
                    rays,
                    self.rays,
                )
        return JointFace(
            z_um=z_um,
            lattice=points,
            covers=covers,
            sends=sends,
            light=light,
            is_sharp=is_sharp,
            joins_light=thin,
            finish=finish,
            images=images,
        )

    def _met(self, lattice: Lattice, z_um: float, face: ShadedFace | None) -> Lattice:
        """Return the points of a height, seen from focus, that rays meet."""
        return met_lattice(
            lattice,
            self.microscope,
            z_um,
            ray_count(lattice, self.rays),
            finest_um=math.inf if face is None else face.light.step_um,
        )

    @property
    def near_um(self) -> float:
        """Return the radius of blur up to which a face counts as near focus."""
        return _NEAR * 2 * fine_um(self.microscope)

    def _lattice(
        self,
        heights_um: Sequence[float],
        shaded: Sequence[ShadedFace],
        sharp_um: float,
        finer: float,
    ) -> Lattice:
        """Return points as far apart as blurs of heights and faces allow."""
        m = self.microscope
        hiding = [r for z in heights_um if (r := self.reach_um(z)) > sharp_um]
        reach = [self.reach_um(each.light.z_um) for each in shaded]
        lit = [
            max(each.light.step_um, r / _SHADED)
            for each, r in zip(shaded, reach, strict=True)
        ]
        widest = max(*hiding, *reach, 0.0, 0.0)
        steps = [r / _HIDING / finer for r in hiding]
        step = min([*steps, *lit], default=math.inf)
        if not math.isfinite(step):
            step = m.um_per_px * max(self.frame.rows, self.frame.columns)
        step = max(step, 2 * fine_um(m) / finer, widest / WIDEST)
        # images of nearly the same blur share their points
        step = 2.0 ** (math.floor(_STEPS * math.log2(step)) / _STEPS)
        return Lattice.over(area_um(m, self.frame, self.shift_um, 0.0), step)

    def _is_thin(self, light: Irradiance) -> bool:
        """Return whether the light changes within what a pixel or the lens resolves."""
        fine = 2 * fine_um(self.microscope)
        is_wide = self.reach_um(light.z_um) > max(light.step_um / 2, fine)
        return light.step_um < fine and not is_wide

    def reach_um(self, z_um: float) -> float:
        """Return how far aside rays through one point of the image meet a height."""
        return self.microscope.blur_diameter_um(z_um - self.focus_um) / 2

    def at_pixels(self, values: FloatArray, lattice: Lattice) -> FloatArray:
        """Return values of a lattice at the pixels, (rows, columns)."""
        if not values.any():
            return np.zeros((self.frame.rows, self.frame.columns))
        x, y = pixel_axes_um(self.microscope, self.frame, self.shift_um)
        return lattice.read(values, x, y)


def _by_height(seen: Sequence[Covered]) -> list[list[Covered]]:
    """Return layers by height and finish, the lowest first."""
    ordered = sorted(seen, key=lambda c: (c.layer.z_um, c.layer.finish, c.layer.name))
    groups = itertools.groupby(ordered, key=lambda c: (c.layer.z_um, c.layer.finish))
    return [list(group) for _, group in groups]
