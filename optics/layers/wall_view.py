"""What walls of bodies change of an image, at its pixels."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import area_um
from microplan.optics.layers.joint.joint_occlusion import JointResidual
from microplan.optics.layers.lattice import Area, Lattice, blur, margin
from microplan.optics.layers.shaded_view import ShadedFace, ShadedView
from microplan.optics.layers.solids.solid_bodies import (
    LightTable,
    SentLight,
    SolidFace,
    is_solid,
    solid_bodies,
)
from microplan.optics.layers.solids.straight_rays import ThickBody
from microplan.optics.layers.solids.view_change import (
    is_cut,
    mirrored_below,
    mirrored_view,
    solid_view,
)
from microplan.optics.outline.clip import grown
from microplan.optics.render.render import Covered, cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Scene

# Walls are traced from points this far apart, but from at most so many a side, and
# meet light on points as far apart as the second two say.
_WALLS_UM, _WALLS_MOST = 4.0, 40
_FINE_UM, _FINE_MOST = 1.0, 120
_MIRRORED_UM, _MIRRORED_MOST = 1.5, 200
_TABLE_UM, _TABLE_MOST = 2.0, 120

_USUAL = Sampling()  # of what bodies cut of the plane in focus, with all rays

# The light on a height, world um, all over an area, um
FarLight = Callable[[float, Area], LightTable]


def wall_residual(
    view: ShadedView,
    scene: Scene,
    covered: Sequence[Covered],
    shaded: Mapping[float, ShadedFace],
    far_light: FarLight,
    *,
    is_fine: bool = False,
) -> FloatArray | None:
    """Return what walls change of a blended image, (rows, columns), None if nothing.

    Share of full scale, at the pixels.

    Parameters
    ----------
    view : ShadedView
        The image.
    covered : sequence of Covered
        All layers of the scene, blurred.
    shaded : mapping of float to ShadedFace
        By height, what is shaded.
    far_light : FarLight
        The light outside what is seen straight, where mirrored rays end.
    is_fine : bool
        Whether walls are traced from closer points, and bodies out of focus by more
        than half a depth of field as such: beside edges near focus what walls hide
        changes fast.
    """
    if not is_solid([c.layer for c in covered]):
        return None
    m, finer, layers = view.microscope, view.rays, [c.layer for c in covered]
    closer, more = view.walls or finer, margin(finer)
    area = area_um(m, view.frame, view.shift_um, 0.0)
    side = max(area[2] - area[0], area[3] - area[1])
    walls_um, most = (_FINE_UM, _FINE_MOST) if is_fine else (_WALLS_UM, _WALLS_MOST)
    lattice = Lattice.over(area, max(walls_um, side / most) / closer, more=more)
    low_um = min(la.z_um if la.underside_um is None else la.underside_um
                 for la in layers)  # fmt: skip
    floor_um = low_um - 1 if (z := scene.background_z_um) is None else z
    heights = [*(layer.z_um for layer in layers), low_um, floor_um]
    far_um = _mirrored_um(view, layers, floor_um)
    widest = max(far_um, *(view.reach_um(height) for height in heights))
    around = grown(area, widest)
    sharp_um = view.near_um / view.reach_um(view.focus_um + 1.0)
    if is_fine:
        sharp_um = min(sharp_um, m.wave_depth_um / 2)
    found = solid_bodies(layers, view.focus_um, around, sharp_um)
    found.sort(key=lambda pair: (pair[0].z_um, pair[0].name))
    tables = {
        z_um: _table(
            face, area_um(m, view.frame, view.shift_um, z_um - view.focus_um), finer
        )
        for z_um, face in shaded.items()
    }
    args = (
        *_sending(found, tables, scene.background, floor_um),
        floor_um - view.focus_um,
    )
    coverage = {id(c.layer): c.coverage for c in covered}
    sharp = [(la, coverage[id(la)]) for la, body in found if body.is_sharp]
    change, seen_below = solid_view(*args, lattice, m, finer=finer)
    image = _laid(view, change, lattice, sharp)
    if cut := [layer for layer, body in found if is_cut(body)]:
        image -= _cut(view, cut, sharp) * view.at_pixels(seen_below, lattice)
    close = Lattice.over(
        area, max(_MIRRORED_UM, side / _MIRRORED_MOST) / closer, more=more
    )
    if far_um == 0 or all(body.wall_reflectance == 0 for _, body in found):
        return image
    wide = {
        z_um: replace(table, beyond=far_light(z_um, grown(area, far_um)))
        for z_um, table in tables.items()
    }
    args = *_sending(found, wide, scene.background, floor_um), floor_um - view.focus_um
    mirrors = mirrored_view(*args, close, m, finer=finer)
    image += _laid(view, _diffracted(view, mirrors, close), close, sharp)
    free = math.prod(1 - share for _, share in sharp)
    below = mirrored_below(*args, lattice, m, finer=finer)
    return image + free * view.at_pixels(below, lattice)


def _mirrored_um(view: ShadedView, layers: Sequence[Layer], low_um: float) -> float:
    """Return how far from what is seen rays end that walls mirror, 0: there are none.

    They come to the highest wall as far aside as that is seen, and go on down.
    """
    tops = [layer.z_um for layer in layers if layer.wall_reflectance > 0]
    if not tops:
        return 0.0
    down_um = view.microscope.blur_diameter_um(max(tops) - low_um) / 2
    return view.reach_um(max(tops)) + down_um


def _sending(
    found: Sequence[tuple[Layer, ThickBody]],
    tables: Mapping[float, LightTable],
    background: float,
    floor_um: float,
) -> tuple[list[SolidFace], SentLight]:
    """Return what bodies send back, and the plane below everything."""
    faces = [
        SolidFace(body=body, sends=_sent(tables.get(layer.z_um), layer))
        for layer, body in found
    ]
    floor = tables.get(floor_um)
    return faces, SentLight(table=floor, reflectance=background, finish=0.0)


def _diffracted(
    view: ShadedView, change: JointResidual, lattice: Lattice
) -> JointResidual:
    """Return fields, means over cells, as the lens shows the plane in focus.

    What lies as high as that plane is in focus in a vertical mirror, too.
    """
    fields = np.stack([change.below, *change.sharp, change.above])
    step = lattice.step_um
    seen = blur(fields, step, view.microscope, view.model, 0.0, cell_um=step)
    return JointResidual(above=seen[-1], sharp=tuple(seen[1:-1]), below=seen[0])


def _laid(
    view: ShadedView,
    change: JointResidual,
    lattice: Lattice,
    sharp: Sequence[tuple[Layer, FloatArray]],
) -> FloatArray:
    """Return fields at the pixels, past layers near focus with their coverage."""
    image = view.at_pixels(change.below, lattice)
    pairs = zip(sharp, change.sharp, strict=True)
    for _, group in itertools.groupby(pairs, key=lambda pair: pair[0][0].z_um):
        own = [(la, share, light) for (la, share), light in group]
        image *= 1 - np.sum([share for _, share, _ in own], axis=0)
        for layer, share, light in own:
            sent = layer.reflectance * share
            image += sent * view.at_pixels(light, lattice)
    return image + view.at_pixels(change.above, lattice)


def _cut(
    view: ShadedView,
    through: Sequence[Layer],
    sharp: Sequence[tuple[Layer, FloatArray]],
) -> FloatArray:
    """Return what bodies cover in the plane in focus, (rows, columns), 0..1."""
    free = 1 - sum((share for _, share in sharp), np.zeros(()))
    m = view.microscope
    if view.rays < 1:
        area = area_um(m, view.frame, view.shift_um, 0.0)
        points = Lattice.over(area, m.um_per_px)
        cells = np.sum([points.covered(la, view.rays) for la in through], axis=0)
        seen = blur(cells, m.um_per_px, m, view.model, 0.0, cell_um=m.um_per_px)
        whole = view.at_pixels(seen, points)
    else:
        sections = [replace(layer, z_um=view.focus_um) for layer in through]
        found = cover(
            sections, m, focus_um=view.focus_um, model=view.model,
            window=view.frame, shift_um=view.shift_um, sampling=_USUAL,
        )  # fmt: skip
        whole = np.sum([each.coverage for each in found], axis=0)
    return np.asarray(np.clip(whole, 0.0, free))


def _table(face: ShadedFace, area: Area, finer: float) -> LightTable:
    """Return the light on a face at points all over an area."""
    step = max(_TABLE_UM, (area[2] - area[0]) / _TABLE_MOST) / finer
    lattice = Lattice.over(area, step, more=0)
    return LightTable(lattice=lattice, share=face.on(lattice).astype(np.float32))


def _sent(table: LightTable | None, layer: Layer) -> SentLight:
    """Return what a layer sends back."""
    return SentLight(table=table, reflectance=layer.reflectance, finish=layer.finish)
