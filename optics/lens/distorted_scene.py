"""Scenes distorted by an imperfect lens, for the renderer of an ideal one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from microplan.arrays import Box, FloatArray
from microplan.optics.lens.displacement import REACH, corner_um, displaced_far
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.offset import offset
from microplan.optics.outline.outline import Arc, Edge, Outline
from microplan.optics.outline.warp import scaled, warped
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope

# Edges in focus that are farther apart than this, in wavelength / A, can be blended
# one over the other: that errs by .01 at most, as the ledger says.
_BESIDE = 3.0


def lens_scene(
    scene: Scene, microscope: Microscope, errors: LensErrors, focus_um: float
) -> Scene:
    """Return the scene that an ideal lens would image like this lens images `scene`.

    Parameters
    ----------
    scene : Scene
        The scene in the world frame.
    errors : LensErrors
        The lens; only what is known of it is applied.
    focus_um : float
        World height of the plane in focus.

    Returns
    -------
    Scene
        The same object where nothing known changes it. Else edges are offset, then
        displaced as in `microplan.optics.lens.displacement.displaced_far`, by arcs
        within `microplan.optics.outline.warp.WARP_UM` unless the map is a similarity,
        which keeps every edge; and layers are raised by `curvature_um`. Aperture and
        light are not of the scene: `microplan.optics.lens.lens.LensErrors`.

    Raises
    ------
    ValueError
        If the focus is not finite, an offset makes a shape vanish (the layer is named),
        or the scale is not positive at a layer's defocus.
    """
    if not math.isfinite(focus_um):
        raise ValueError(f"focus_um must be finite, got {focus_um}")
    if not errors.changes_scene:
        return scene
    raised = curvature_um(scene.layers, microscope, errors)
    layers = tuple(
        replace(
            layer,
            outline=_imaged(layer, microscope, errors, layer.z_um - focus_um),
            z_um=layer.z_um + up,
            underside_um=None
            if layer.underside_um is None
            else layer.underside_um + up,
        )
        for layer, up in zip(scene.layers, raised, strict=True)
    )
    return replace(scene, layers=layers)


def _imaged(
    layer: Layer, microscope: Microscope, errors: LensErrors, z_um: float
) -> Outline:
    """Return a layer's outline as fabricated and as displaced."""
    try:
        made = offset(layer.outline, errors.edge_offset_um)
    except ValueError as error:
        raise ValueError(f"layer {layer.name!r}: {error}") from error
    return imaged(made, microscope, errors, defocus_um=z_um)


def imaged(
    outline: Outline, microscope: Microscope, errors: LensErrors, *, defocus_um: float
) -> Outline:
    """Return an outline where the lens shows it; the same object if it stays there.

    Errors as in `lens_scene`; the edge offset is not applied.
    """
    if not errors.moves_points:
        return outline
    if errors.distortion == 0:
        factor = 1 + errors.scale_per_um * defocus_um
        shift = (errors.lateral_x * defocus_um, errors.lateral_y * defocus_um)
        return scaled(outline, factor, shift)

    def moved(points: FloatArray) -> FloatArray:
        return displaced_far(points, errors, microscope, defocus_um=defocus_um)

    return warped(outline, moved)


def curvature_um(
    layers: Sequence[Layer], microscope: Microscope, errors: LensErrors
) -> tuple[float, ...]:
    """Return how much higher each layer is imaged by the curved field, um.

    Half the sum of the least and the largest r**2 / (2 R) over the layer's edges in the
    field, which leaves `curvature_rest_um` on both sides. Layers over or next to one
    another are raised alike where they would else change their order, or where those of
    one height would else be blended and no longer added.
    """
    if errors.field_curvature_per_um == 0:
        return (0.0,) * len(layers)
    spans = [_squares(layer.outline, microscope) for layer in layers]
    boxes = [
        layer.outline.bounds_um if layer.outline.rings else None for layer in layers
    ]
    gap = _BESIDE * microscope.wavelength_um / microscope.aperture
    group = list(range(len(layers)))
    while True:
        up = _raised(spans, group, errors.field_curvature_per_um)
        clashes = (
            (group[i], group[j])
            for i, j in itertools.combinations(range(len(layers)), 2)
            if group[i] != group[j]
            and _near(boxes[i], boxes[j], gap)
            and _reordered(layers[i].z_um, layers[j].z_um, up[i], up[j])
        )
        keep, drop = next(clashes, (None, None))
        if keep is None:
            return tuple(up)
        group = [keep if g == drop else g for g in group]


def curvature_rest_um(
    outline: Outline, microscope: Microscope, errors: LensErrors
) -> float:
    """Return the defocus, +- um, that one height for the whole outline leaves out."""
    low, high = _squares(outline, microscope)
    return abs(errors.field_curvature_per_um) * (high - low) / 4


def _raised(
    spans: Sequence[tuple[float, float]], group: Sequence[int], curvature: float
) -> list[float]:
    """Return the raise of each layer, the same within a group."""
    raised = {}
    for name in set(group):
        own = [span for span, g in zip(spans, group, strict=True) if g == name]
        middle = (min(low for low, _ in own) + max(high for _, high in own)) / 2
        raised[name] = curvature * middle / 2
    return [raised[name] for name in group]


def _reordered(z: float, other_z: float, up: float, other_up: float) -> bool:
    """Return whether two heights change their order, or one of two equal ones moves."""
    before, after = z - other_z, (z + up) - (other_z + other_up)
    return before * after <= 0 and (before != 0 or after != 0)


def _near(one: Box | None, other: Box | None, gap_um: float) -> bool:
    """Return whether two boxes come within a gap of each other."""
    if one is None or other is None:
        return False
    return (
        one[0] <= other[2] + gap_um
        and other[0] <= one[2] + gap_um
        and one[1] <= other[3] + gap_um
        and other[1] <= one[3] + gap_um
    )


def _squares(outline: Outline, microscope: Microscope) -> tuple[float, float]:
    """Return the least and the largest r**2 of edges, um2, at most at the reach."""
    spans = [_distances(edge) for ring in outline.rings for edge in ring.edges]
    if not spans:
        return (0.0, 0.0)
    limit = REACH * corner_um(microscope)
    low = min(limit, *(near for near, _ in spans))
    high = min(max(far for _, far in spans), limit)
    return (low**2, high**2)


def _distances(edge: Edge) -> tuple[float, float]:
    """Return the least and the largest distance of an edge from the axis, um."""
    ends = [math.hypot(*edge.start), math.hypot(*edge.end)]
    if isinstance(edge, Arc):
        away = math.hypot(*edge.center)
        toward = math.atan2(-edge.center[1], -edge.center[0])
        near = [abs(away - edge.radius_um)] if _passes(edge, toward) else []
        far = [away + edge.radius_um] if _passes(edge, toward + math.pi) else []
        return (min(ends + near), max(ends + far))
    (x, y), (p, q) = edge.start, edge.end
    length2 = (p - x) ** 2 + (q - y) ** 2
    t = -(x * (p - x) + y * (q - y)) / length2 if length2 else 0.0
    t = min(max(t, 0.0), 1.0)
    return (math.hypot(x + t * (p - x), y + t * (q - y)), max(ends))


def _passes(arc: Arc, angle: float) -> bool:
    """Return whether an arc passes a direction from its centre."""
    sign = math.copysign(1.0, arc.sweep_rad)
    return (sign * (angle - arc.start_rad)) % (2 * math.pi) <= abs(arc.sweep_rad)
