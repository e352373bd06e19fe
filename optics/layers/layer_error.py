"""Image error of layers of different height, by the treatment of their overlap.

Blending errs where the same rays pass near edges of two layers. That is measured here
on the scene itself, at points where such edges meet, by rays that are displaced by the
Airy pattern as well. Joint occlusion has that in the image. Rays neglect diffraction
between one layer and the next; that comes on top, for the light that reaches the lower
one: by waves at the worst points, or by a bound of pairs that are both near focus.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.diffraction.pupil_grid import height_of
from microplan.optics.layers.diffraction.worst_changes import most_by_waves
from microplan.optics.layers.layer_edges import LayerFace, Points, faces, meeting_points
from microplan.optics.layers.ray_probes import light_shares, probe_error, probes
from microplan.optics.layers.shaded_view import ShadedView
from microplan.optics.outline.tolerant_order import at_most, least
from microplan.optics.render.fidelity import rounded_up
from microplan.optics.render.scene import Scene, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

TREATMENTS = ("joint", "occluded")  # of looks, the cheapest first
KNOWN = ("blend", *TREATMENTS)
# Largest difference between a wave calculation of two straight edges and traced rays,
# of unit contrast (`benchmarks.optics.layers`); heights in n wavelength / A**2 from
# focus, distances beyond both blurs in wavelength / A.
_MOST = 0.105  # where one of the two is near focus: half of the pupil is cut off
_FALL = 0.137  # over the root of the smaller of the two heights
_CLOSE = 0.168  # times the root of the distance between the layers
_APART = 1.1  # per root of 1 + that distance
# Where several edges are near: power of their lengths, each counted up to 4, the most
# that two bars have (`benchmarks.optics.layers`).
_CROWDED, _CROWD = 0.4, 4.0
# Rays and cells of `occluded` with the usual settings (`benchmarks.optics.layers`), and
# what a cell costs that two sharp edges share (tested).
_TRACED, _SHARED = 0.012, 0.025
# Both this near focus, n wavelength / A**2, waves find more than there is.
_NEAR = 4.0
_FIRST, _FINAL = 128, 1024  # rays a point: for all of them, and for the worst ones
_WORST = 120  # points that are looked at again


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRefusal:
    """A cheaper treatment that was tried and not taken."""

    treatment: str
    predicted_error: float  # share of full scale


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerChoice:
    """The treatment of overlapping layers, and its largest image error."""

    treatment: str  # one of `TREATMENTS`
    predicted_error: float  # share of full scale
    limit: float
    refused: tuple[LayerRefusal, ...]

    @property
    def keeps_limit(self) -> bool:
        """Return whether the predicted error is within the limit."""
        return at_most(self.predicted_error, self.limit)


def choose_layers(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: Sequence[float],
    limit: float,
    window: Window | None = None,
    lamp_aperture: float | None = None,
) -> LayerChoice:
    """Return the cheapest treatment whose predicted error fits, else the best one.

    Parameters
    ----------
    scene, microscope, window, lamp_aperture
        As in `layer_error`.
    focus_um : sequence of float
        World heights in focus that the choice must hold for, at least one.
    limit : float
        Admissible image error, share of full scale.

    Raises
    ------
    ValueError
        If `limit` is not positive and finite, or no focus is given.
    """
    if not (limit > 0 and math.isfinite(limit)):
        raise ValueError(f"limit must be positive and finite, got {limit}")
    if not focus_um:
        raise ValueError("focus_um must hold at least one height")
    tried: list[LayerRefusal] = []
    for treatment in TREATMENTS:
        errors = [
            layer_error(
                scene,
                microscope,
                focus_um=z,
                treatment=treatment,
                window=window,
                lamp_aperture=lamp_aperture,
            )
            for z in focus_um
        ]
        tried.append(LayerRefusal(treatment=treatment, predicted_error=max(errors)))
        if at_most(tried[-1].predicted_error, limit):
            break
    # the cheaper of two that err alike comes first
    best = next((t for t in tried if at_most(t.predicted_error, limit)), None)
    best = best or least(tried, lambda t: t.predicted_error)
    return LayerChoice(
        treatment=best.treatment,
        predicted_error=best.predicted_error,
        limit=limit,
        refused=tuple(t for t in tried if t is not best),
    )


def layer_error(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    treatment: str,
    window: Window | None = None,
    lamp_aperture: float | None = None,
    diffracts: bool = True,
) -> float:
    """Return the largest image error that a treatment of layers is predicted to make.

    Parameters
    ----------
    focus_um : float
        World height of the plane in focus.
    treatment : str
        "blend" for `microplan.optics.render.render`, "joint" for
        `microplan.optics.layers.shading.render_coaxial`, "occluded" for
        `microplan.optics.layers.occlusion.occluded` with its usual settings. There is
        none for layers within a depth of field, which `occluded` hides before it blurs.
    window : Window, optional
        The part of the frame that matters. Default: all.
    lamp_aperture : float, optional
        Of coaxial light that the image has shaded. Default: nothing is shaded.
    diffracts : bool
        Whether layers diffract light on its way to others, and rays are few. False:
        the error is that of blending, against rays.

    Returns
    -------
    float
        Share of full scale, two digits, rounded up; 0 where no edges of two heights
        come near the window.

    Raises
    ------
    ValueError
        If the treatment is unknown or the focus not finite.

    Notes
    -----
    Diffraction: the edge of one layer cuts the pupil through which the other is seen.
    By waves (`microplan.optics.layers.diffraction`) if one is out of focus. Between two
    near focus a bound of .105 is taken for each pair, which falls with their distance
    and with the gap between edges.
    """
    if treatment not in KNOWN:
        raise ValueError(
            f"treatment must be one of {', '.join(KNOWN)}, got {treatment!r}"
        )
    if not math.isfinite(focus_um):
        raise ValueError(f"focus_um must be finite, got {focus_um}")
    found = faces(scene, microscope, focus_um, window or full(microscope))
    points = meeting_points(found, microscope, window or full(microscope))
    if not len(points.at_um):
        return 0.0
    rest = np.zeros(len(points.at_um))
    if diffracts:
        rest = _diffraction(
            found, points, scene.background, microscope, lamp_aperture,
            traced=treatment == "occluded",
        )  # fmt: skip
    blended = _blended(found, treatment, microscope, window)
    if len(blended) < 2:
        return rounded_up(float(rest.max()))
    return rounded_up(_blend_error(scene, microscope, blended, points.at_um, rest))


def _diffraction(
    found: Sequence[LayerFace],
    points: Points,
    background: float,
    microscope: Microscope,
    lamp_aperture: float | None,
    *,
    traced: bool,
) -> FloatArray:
    """Return the diffraction error at points, (N,) of full scale."""
    light = np.ones((len(found), len(points.at_um)))
    rasters = probes(microscope, found, points.at_um, are_lit=lamp_aperture is not None)
    if lamp_aperture is not None:
        light = light_shares(rasters, microscope, lamp_aperture, points.at_um, _FIRST)
    most = math.inf
    if any(abs(height_of(microscope, face.z_um)) > _NEAR for face in found):
        most = most_by_waves(
            rasters,
            background,
            microscope,
            points.at_um,
            light=light,
            steps=[face.step for face in found],
            bound=diffraction_error(
                found, points, microscope, traced=False, light=light
            ),
        )
    return diffraction_error(
        found, points, microscope, traced=traced, light=light, most=most
    )


def _blended(
    found: Sequence[LayerFace],
    treatment: str,
    microscope: Microscope,
    window: Window | None,
) -> Sequence[LayerFace]:
    """Return the faces that a treatment blends: of joint occlusion those near focus."""
    if treatment != "joint":
        return found if treatment == "blend" else ()
    view = ShadedView(
        microscope=microscope,
        focus_um=0.0,
        model="exact",
        frame=window or full(microscope),
        shift_um=(0.0, 0.0),
    )
    return [face for face in found if face.blur_um <= view.near_um]


def _blend_error(
    scene: Scene,
    microscope: Microscope,
    found: Sequence[LayerFace],
    at_um: FloatArray,
    rest: FloatArray,
) -> float:
    """Return the largest error of blending at points, with the rest's added."""
    rasters = probes(microscope, found, at_um)
    first = rest + probe_error(
        rasters, scene.background, microscope, at_um, _FIRST, fine=False
    )
    worst = np.argsort(-first, kind="stable")[:_WORST]
    again = probe_error(
        rasters, scene.background, microscope, at_um[worst], _FINAL, fine=True
    )
    return float((rest[worst] + again).max())


def diffraction_error(
    found: Sequence[LayerFace],
    points: Points,
    microscope: Microscope,
    *,
    traced: bool,
    light: FloatArray,
    most: float = math.inf,
) -> FloatArray:
    """Return the diffraction error of traced rays at points near edges.

    Parameters
    ----------
    found : sequence of LayerFace
        The scene's faces, the lowest first.
    points : Points
        Where edges meet.
    traced : bool
        Whether to add what the number of rays and the cells of `occluded` cost.
    light : (faces, N) float array
        Share of the light that reaches what a point sees of each face.
    most : float
        By `most_by_waves`, of pairs of which one is out of focus. Default: they too are
        bounded.

    Returns
    -------
    (N,) float64 array
        A bound, share of full scale: the sum of bounds of pairs.
    """
    airy = microscope.wavelength_um / microscope.aperture
    close, apart, cells = np.zeros((3, len(points.at_um)))
    for (i, low), (j, high) in itertools.combinations(enumerate(found), 2):
        depths = [height_of(microscope, f.z_um) for f in (low, high)]
        gap = depths[1] - depths[0]
        each = min(_MOST, _CLOSE * math.sqrt(gap))
        nearer, farther = sorted(abs(depth) for depth in depths)
        if nearer > 0:
            each = min(each, _FALL / math.sqrt(nearer))
        beyond = points.away_um[i] + points.away_um[j] - low.blur_um - high.blur_um
        beyond = np.maximum(beyond, 0) / airy / math.sqrt(1 + gap)
        crowd = np.clip(points.crowding[[i, j]], 1, _CROWD)
        share = low.step * light[i] / (1 + _APART * beyond)
        total = close if farther <= _NEAR else apart
        total += share * each * crowd.prod(axis=0) ** _CROWDED
        if traced:
            sharp = low.blur_um + high.blur_um < airy
            cells += share * (_TRACED + _SHARED * sharp)
    return close + (most if math.isfinite(most) else apart) + cells
