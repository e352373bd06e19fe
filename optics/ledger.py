"""The effects ledger: which optical effect is modelled, at what level and cost."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from optics.clip import to_edges
from optics.fidelity import Fidelity
from optics.microscope import Microscope
from optics.scene import Layer, Scene
from optics.spectrum import boundary_nodes

FloatArray = npt.NDArray[np.float64]

# Blending two layers by coverage, front in focus, edges touching, by the defocus of
# the back (wave calculation), and both in focus by the gap between the edges.
_BACK_UM, _BACK_ERROR = (
    (0.0, 1.0, 2.5, 5.0, 10.0, 25.0),
    (0.25, 0.16, 0.1, 0.05, 0.03, 0.014),
)
_GAP_UM, _GAP_ERROR = (0.0, 1.0, 3.0), (0.25, 0.03, 0.01)
_TWO_BLURS = 0.2  # two defocused edges that overlap, geometrical optics
_COHERENT_EDGE = 0.26  # worst of coherence .1, .5 and 1 on an amplitude edge
_COHERENT_SHIFT = 0.108  # of its 50 % point, in wavelength / A
_VECTORIAL_OTF = 0.019  # at `_VECTORIAL_APERTURE` in air; grows with A**2
_VECTORIAL_APERTURE = 0.42
_BAND_30_PERCENT = 0.0013  # a flat 30 % band of wavelengths, in an edge
_SAMPLES = 4000  # boundary points a layer when gaps are measured


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerRow:
    """One effect, how it is treated, and what leaving the rest out costs.

    `predicted_error` and `limit` are in the unit that `unit` names; None where nobody
    predicts it yet, and then `level` says `not modelled`.
    """

    effect: str
    level: str
    predicted_error: float | None
    limit: float | None
    unit: str  # "unit contrast", "um", ...
    reason: str


def ledger(
    scene: Scene, microscope: Microscope, focus_um: float, fidelity: Fidelity
) -> tuple[LedgerRow, ...]:
    """Return what a rendered image models, and what the rest may cost.

    Parameters
    ----------
    scene : Scene
        What is rendered.
    microscope : Microscope
        The optical setting.
    focus_um : float
        World height of the plane in focus.
    fidelity : Fidelity
        How it is rendered, see `optics.fidelity.choose`.

    Returns
    -------
    tuple of LedgerRow
        Always the same effects in the same order. Predictions are bounds of single
        effects; they do not add up to a bound of the image.
    """
    limit = fidelity.limit
    blend, why = blend_error(scene, microscope, focus_um)
    return (
        _law_row(fidelity),
        _row("layer blending", "coverage, back to front", blend, limit, why),
        *_sampling_rows(fidelity),
        *_missing_rows(microscope, limit),
    )


def _law_row(fidelity: Fidelity) -> LedgerRow:
    """Return the row of law and sampling, with the cheaper laws that were refused."""
    refused = ", ".join(
        f"{r.model} errs by {r.predicted_error:.2g}" for r in fidelity.refused
    )
    return _row(
        "defocus law",
        fidelity.model,
        fidelity.predicted_error,
        fidelity.limit,
        f"measured on this scene; {refused or 'the cheapest law will do'}",
    )


def blend_error(
    scene: Scene, microscope: Microscope, focus_um: float
) -> tuple[float, str]:
    """Return what blending the worst pair of layers costs, and which pair that is.

    Edges farther apart than both blurs and three Airy units err by .01 at most; layers
    of equal height are added before they are blended and err by nothing.
    """
    worst, why = 0.0, "no two layers of different height"
    for one, other in itertools.combinations(scene.layers, 2):
        if one.z_um == other.z_um or not (one.outline.rings and other.outline.rings):
            continue
        back, front = sorted((one, other), key=lambda layer: (layer.z_um, layer.name))
        error, gap = _pair_error(back, front, microscope, focus_um)
        if error > worst:
            worst = error
            why = f"{front.name} over {back.name}, edges {gap:.3g} um apart"
    return worst, why


def _pair_error(
    back: Layer, front: Layer, microscope: Microscope, focus_um: float
) -> tuple[float, float]:
    """Return the blending error of two layers and the gap between their edges, um."""
    gap = _gap_um(back, front)
    z_back, z_front = (abs(layer.z_um - focus_um) for layer in (back, front))
    reach = (
        microscope.blur_diameter_um(z_back) + microscope.blur_diameter_um(z_front)
    ) / 2 + 3 * microscope.wavelength_um / microscope.aperture
    if gap > reach:
        return _GAP_ERROR[-1], gap
    depth = microscope.wave_depth_um / 2
    if z_front > depth:
        return _TWO_BLURS, gap
    if z_back > depth:
        return float(np.interp(z_back, _BACK_UM, _BACK_ERROR)), gap
    return float(np.interp(gap, _GAP_UM, _GAP_ERROR)), gap


def _gap_um(one: Layer, other: Layer) -> float:
    """Return the smallest distance between edges of two layers, um, never too large.

    Nodes for a frequency f lie at most .65 / f apart, so that much is taken off.
    """
    clouds, spacing = [], 0.0
    for layer in (one, other):
        density = _SAMPLES / layer.outline.perimeter_um
        x, y, _, _ = boundary_nodes(to_edges(layer.outline), density)
        clouds.append(np.column_stack([x, y]))
        spacing += 0.65 / density / 2
    return max(_nearest_um(*clouds) - spacing, 0.0)


def _nearest_um(one: FloatArray, other: FloatArray) -> float:
    """Return the smallest distance between points of two clouds, (N, 2) um each.

    The tree is over the smaller body, as all of a large ring is about equally far from
    its middle; and no point farther off than the best of a few is looked for.
    """
    small, large = sorted(
        (one, other), key=lambda cloud: float(np.ptp(cloud, axis=0).max())
    )
    tree = cKDTree(small)
    few, _ = tree.query(large[:: math.isqrt(len(large))])
    bound = float(np.min(few))
    distance, _ = tree.query(large, distance_upper_bound=math.nextafter(bound, 1e300))
    return float(min(np.min(distance), bound))


def _sampling_rows(fidelity: Fidelity) -> tuple[LedgerRow, ...]:
    limit, sampling = fidelity.limit, fidelity.sampling
    return (
        _row("pixel integration", "area of a pixel", 0.0, limit, "exact in the band"),
        _row(
            "band and tile",
            f"cut at {sampling.band_error:.2g}, margin {sampling.margin:.3g} lambda/A",
            fidelity.sampling_error,
            limit,
            "with the exact law, measured on this scene",
        ),
    )


def _missing_rows(microscope: Microscope, limit: float) -> tuple[LedgerRow, ...]:
    """Return the effects left out, with their size where it is known."""
    airy = microscope.wavelength_um / microscope.aperture
    steep = (microscope.aperture / microscope.medium_index / _VECTORIAL_APERTURE) ** 2
    known = (
        ("partial coherence", _COHERENT_EDGE, "full-contrast amplitude edge, worst"),
        ("vectorial field", _VECTORIAL_OTF * steep, "of the transfer function"),
        ("spectrum of the light", _BAND_30_PERCENT, "flat 30 % band, in an edge"),
    )
    unknown = ("side walls", "shading by taller bodies", "aberrations of the lens")
    return (
        *(_row(e, "not modelled", size, limit, why) for e, size, why in known),
        LedgerRow(
            effect="edge offset by coherence",
            level="not modelled",
            predicted_error=_COHERENT_SHIFT * airy,
            limit=None,
            unit="um",
            reason="shift of the 50 % point; centroids of symmetric parts stay",
        ),
        *(_row(e, "not modelled", None, limit, "nobody predicts it") for e in unknown),
    )


def _row(
    effect: str, level: str, error: float | None, limit: float, reason: str
) -> LedgerRow:
    return LedgerRow(
        effect=effect,
        level=level,
        predicted_error=error,
        limit=limit,
        unit="unit contrast",
        reason=reason,
    )
