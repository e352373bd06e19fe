"""Wavefront errors that an objective may have: known terms, unknown coma and trefoil.

Of all terms these move what a look measures: coma moves any target, trefoil one whose
edges do not look all ways alike, as tips of fingers. Astigmatism and spherical
aberration of the same rms move answers of the examples' looks by less than a tenth of
it, as both sides of a target do alike; what they move is the focus.
"""

from __future__ import annotations

import math

from scipy import special

from microplan.optics.ledger import CONTRAST
from microplan.optics.transfer.microscope import Terms
from microplan.optics.transfer.zernike import turns_of
from microplan.planner.looks.model_errors.halo_ends import IMAGED, LACKING
from microplan.planner.task.workcell import WavefrontSpec
from microplan.schemas.plan import EffectRow

WAVEFRONT, UNKNOWN = "wavefront error", "unknown wavefront error"
# rms of all aberrations of a lens that is called diffraction limited, waves: it leaves
# .8 of the peak of a point's image (Marechal 1943; Born & Wolf, section 9.3)
LIMITED = 1 / 14
SHARED = 7  # terms that an unknown total is made of: Noll 5 to 11, all up to spherical
MOVING = (8, 7, 10, 9)  # Noll's indices: coma along x and y, trefoil
# astigmatism and spherical aberration, alike at opposite points of the pupil: without
# one of such terms an image is as sharp so far above focus as below
FOCUSING = (5, 6, 11)
_HALF = 1.96  # standard deviations of a two-sided 95 % half-width


def unknown_wavefronts(stated: WavefrontSpec) -> tuple[Terms, ...]:
    """Return wavefronts with each of the terms that move by which they may be wrong.

    Each about what is known, at one end of its interval; none where all is known.
    """
    known = dict(stated.known)
    return tuple(
        tuple(sorted((known | {noll: known.get(noll, 0.0) + half}).items()))
        for noll, half in unknown_waves(stated).items()
        if half > 0
    )


def unknown_waves(stated: WavefrontSpec) -> dict[int, float]:
    """Return how large terms that move may be, waves rms, half-widths of 95 %.

    Of a total, whose terms may share it in any way, all directions in their space are
    as likely: along any one of them it is within `total_share` with 95 %.
    """
    if stated.terms is not None:
        return {
            term.noll: _HALF * term.sigma_waves
            for term in stated.terms
            if turns_of(term.noll) % 2
        }
    most = LIMITED if stated.rms_waves is None else stated.rms_waves
    return dict.fromkeys(MOVING, total_share() * most)


def unknown_focusing(stated: WavefrontSpec) -> dict[int, float]:
    """Return half-widths of 95 % of terms by which the best focus may be wrong, waves.

    By Noll's index, those alone that are not known. Of a total, the focus moves with
    one direction in the space of its terms, so that the root of the sum of squares of
    what all of them move is the half-width of 95 %.
    """
    if stated.terms is not None:
        # beside known ones, coma and trefoil change how sharp either side is, too
        halves = {term.noll: _HALF * term.sigma_waves for term in stated.terms}
    else:
        most = LIMITED if stated.rms_waves is None else stated.rms_waves
        halves = dict.fromkeys(FOCUSING, total_share() * most)
    return {noll: half for noll, half in halves.items() if half > 0}


def total_share() -> float:
    """Return what a component of a random direction is below with 95 %, .7.

    The square of one of n components is distributed as Beta(1/2, (n - 1) / 2).
    """
    return math.sqrt(float(special.betaincinv(0.5, (SHARED - 1) / 2, 0.95)))


def wavefront_rows(stated: WavefrontSpec, limit: float) -> tuple[EffectRow, EffectRow]:
    """Return the rows of what is known of the wavefront, and of what is not.

    Before they are charged.
    """
    known = stated.known
    half = max(unknown_waves(stated).values(), default=0.0)
    terms = ", ".join(f"{waves:g} of Noll {noll}" for noll, waves in known)
    words = f"{_total(stated)}coma and trefoil of up to {half:.2g} waves rms each"
    return (
        _row(WAVEFRONT, IMAGED, limit, f"stated, waves rms: {terms}" if known else ""),
        _row(UNKNOWN, LACKING, limit, words if half else ""),
    )


def _row(effect: str, level: str, limit: float, reason: str) -> EffectRow:
    """Return a row that is off where there is no reason for it."""
    return EffectRow(
        effect=effect,
        level=level if reason else "off",
        predicted_error=None if reason and level == LACKING else 0.0,
        limit=limit,
        unit=CONTRAST,
        reason=reason or "none is stated",
    )


def _total(stated: WavefrontSpec) -> str:
    """Return what is known of the size of what is unknown."""
    if stated.terms is not None:
        return "of what is stated: "
    if stated.rms_waves is not None:
        return f"{stated.rms_waves:g} waves rms in all, as stated: "
    return (
        f"not stated; {LIMITED:.2g} waves rms in all, as of a lens that is just "
        "diffraction limited (state `wavefront`): "
    )
