"""Displacement of a look's answer by coherence, measured on dilated outlines.

Partly coherent light moves edges into their bright side, all edges of one contrast
alike but for what a wavefront error of the lens does. How far is an interval, no
standard deviation: the chosen chain measures images of outlines dilated by both of its
ends, and what its answer moves by is a bias.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.trials.bias_prediction import PoseBias, predict_bias
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trials import Map, PreparedRoutines
from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.dilation import differing_um, dilation_um, uneven_um
from microplan.optics.coherence.edge_offsets import amplitude_contrast
from microplan.optics.ledger import NM
from microplan.optics.outline.offset import offset
from microplan.optics.render.fidelity import rounded_up
from microplan.optics.render.scene import Layer
from microplan.planner.assembly.shapes import polygon
from microplan.schemas.plan import EffectRow

_ALIKE = 0.1  # contrasts of amplitudes that differ by less count as one
_TELLS = 0.05  # an edge of less contrast tells nothing
_SHARE = 0.05  # of a target's edges: fewer of another contrast do not move it
_POSES = 4
_NM_PER_UM = 1000.0
FINEST_NM = 0.1  # what moves an answer by less is the arithmetic of a machine


@dataclass(frozen=True, slots=True, kw_only=True)
class CoherenceShift:
    """Half-widths of the bias by coherence, about the answer in incoherent light."""

    um: float = 0.0
    rad: float = 0.0
    dilation_um: float = 0.0  # the greatest that was measured
    differing_um: float = 0.0  # of it what edges of other contrast may add
    uneven_um: float = 0.0  # of it what edges of other directions may add


def coherence_shift(
    case: LookCase,
    prepared: PreparedRoutines,
    chain: Chain,
    coherence: Coherence | None,
    *,
    root_seed: int,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> CoherenceShift:
    """Return how far coherence may move the answer of a chain.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        With the chain's artifacts, made for the look as it is.
    coherence : Coherence, optional
        None: incoherent light, which moves nothing.

    Notes
    -----
    Both ends of the dilation are measured at the same poses as no dilation; the larger
    difference counts, in full as a half-width. A chain that gives no right answer there
    is charged the dilation itself. Where the target's edges have several contrasts,
    half of the greatest dilation is added: so much they may move against each other.
    So is half of what edges of other directions differ by through a lens with a
    wavefront error.
    """
    if coherence is None:
        return CoherenceShift()
    contrasts = edge_contrasts(case)
    telling = contrasts[contrasts > _TELLS]
    main = float(np.median(telling)) if telling.size else 1.0
    ends = dilation_um(coherence, case.microscope, main)
    only = replace(prepared, chains=(chain,))

    def answer(by_um: float) -> PoseBias | None:
        return predict_bias(
            dilated(case, by_um),
            only,
            poses=_POSES,
            root_seed=root_seed,
            map=map,
        ).get(chain)

    plain = answer(0.0)
    moved_um, moved_rad = 0.0, 0.0
    for end_um in sorted({end for end in ends if end}):
        there = answer(end_um)
        if plain is None or there is None:
            moved_um = max(moved_um, abs(end_um))
            continue
        x, y, theta = (b - a for a, b in zip(plain, there, strict=True))
        moved_um, moved_rad = (
            max(moved_um, math.hypot(x, y)),
            max(moved_rad, abs(theta)),
        )
    uneven = uneven_um(coherence, case.microscope, main)
    moved_rad += uneven / max(reach_um(case), uneven) if uneven else 0.0
    more_um = 0.0
    if telling.size and (np.abs(telling - main) > _ALIKE).mean() > _SHARE:
        more_um = differing_um(coherence, case.microscope)
        moved_rad += more_um / max(reach_um(case), more_um)
    return CoherenceShift(
        um=moved_um + more_um + uneven,
        rad=moved_rad,
        dilation_um=max(map(abs, ends)),
        differing_um=more_um,
        uneven_um=uneven,
    )


def moved_rows(
    coherence: Coherence | None, case: LookCase, shift: CoherenceShift
) -> tuple[EffectRow, ...]:
    """Return the ledger's row of what coherence may move, none if it moves nothing."""
    if coherence is None:
        return ()
    words = f"coherence {coherence}{'' if coherence.is_stated else ', not stated'}: "
    words += "the chain measured outlines dilated by up to "
    words += f"{_NM_PER_UM * shift.dilation_um:.3g} nm"
    if shift.differing_um:
        words += f"; edges of other contrast {_NM_PER_UM * shift.differing_um:.3g} nm"
    if shift.uneven_um:
        words += f"; of other directions {_NM_PER_UM * shift.uneven_um:.3g} nm"
    return (
        EffectRow(
            effect="target moved by coherence",
            level="charged",
            predicted_error=rounded_up(_NM_PER_UM * shift.um, FINEST_NM),
            limit=_NM_PER_UM * case.tolerance_um,
            unit=NM,
            reason=words,
        ),
    )


def dilated(case: LookCase, by_um: float) -> LookCase:
    """Return a look whose edges all lie so far, um, in their bright side.

    A body that is too fine for that keeps its edges.
    """
    if by_um == 0:
        return case
    whole = scene(case, 0.0, 0.0, 0.0)
    placed = dict(zip((id(la) for la in (*case.static, *case.moving)), whole.layers,
                      strict=True))  # fmt: skip

    def moved(layers: Sequence[Layer]) -> tuple[Layer, ...]:
        return tuple(
            _grown(layer, by_um * _toward(placed[id(layer)], whole.layers, case))
            for layer in layers
        )

    return replace(case, static=moved(case.static), moving=moved(case.moving))


def edge_contrasts(case: LookCase) -> FloatArray:
    """Return the contrast of amplitudes at points of the target's edges, (N,) 0..1.

    Of what is seen an Airy radius to both sides; sharp, with nothing blurred.
    """
    contour = np.array(case.target.contour, dtype=np.float64).reshape(-1, 4)
    if not len(contour):
        return np.zeros(0)
    c, s = math.cos(case.target.theta_rad), math.sin(case.target.theta_rad)
    turn = np.array([[c, s], [-s, c]])
    at, out = contour[:, :2] @ turn, contour[:, 2:] @ turn
    at = at + (case.x_um, case.y_um)
    off_um = case.microscope.airy_radius_um
    layers = sorted(scene(case, 0.0, 0.0, 0.0).layers, key=lambda layer: layer.z_um)
    sides = [_levels(at + side * off_um * out, layers, case) for side in (1, -1)]
    pairs = zip(*sides, strict=True)
    return np.array([amplitude_contrast(a, b) if a + b > 0 else 0.0 for a, b in pairs])


def _levels(
    points_um: FloatArray, layers: Sequence[Layer], case: LookCase
) -> FloatArray:
    """Return what is sent from points of the world by the highest face there, (N,)."""
    found = np.full(len(points_um), case.background)
    for layer in layers:
        inside = shapely.contains_xy(polygon(layer.outline), *points_um.T)
        clear = layer.transmittance * found
        found = np.where(inside, np.maximum(layer.reflectance, clear), found)
    return found


def _toward(layer: Layer, layers: Sequence[Layer], case: LookCase) -> float:
    """Return 1 for a body darker than what lies under it, which grows, else -1."""
    if not layer.outline.rings:
        return 1.0
    at = np.array([layer.outline.rings[0].edges[0].start])
    lower = sorted((o for o in layers if o.z_um < layer.z_um), key=lambda o: o.z_um)
    return 1.0 if layer.reflectance < float(_levels(at, lower, case)[0]) else -1.0


def _grown(layer: Layer, by_um: float) -> Layer:
    try:
        return replace(layer, outline=offset(layer.outline, by_um))
    except ValueError:  # a wall or a gap would vanish
        return layer


def reach_um(case: LookCase) -> float:
    """Return how far the target's edges lie from its point, um."""
    contour = np.array(case.target.contour, dtype=np.float64).reshape(-1, 4)
    return float(np.hypot(contour[:, 0], contour[:, 1]).max(initial=0.0))
