"""What a wavefront error moves the peak of a focus sweep by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.perturb import as_tried
from microplan.featuresel.look.scenario import LookCase, moved_layers, render_look
from microplan.featuresel.look.static_layers import fresh
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.focus.measures import face_sharpness
from microplan.featuresel.routines.focus.peak import mirror_peak
from microplan.optics.transfer.microscope import Terms
from microplan.optics.transfer.zernike import turns_of
from microplan.planner.looks.model_errors.wavefront_ends import unknown_focusing
from microplan.planner.task.workcell import WavefrontSpec

# Stops about the face that are rendered: those farther off score next to nothing, and
# change a bias by less than a hundredth of it (tested).
_STOPS = 41
# Of a bias, the half-width by which images through a wavefront error have it wrong: the
# simulated cell's, by its own pupil, differ by 5 % at most (tested).
_IMAGED = 0.1
# Waves, at most, by which a term is changed to see what it moves: farther off peaks
# turn back, which makes no doubt smaller.
_STEP = 0.05
_TURNS_RAD = tuple(math.pi / 4 * k for k in range(4))  # quarters of astigmatism's turn
_QUARTERS = np.array([1, 1j, -1, -1j])


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepBias:
    """Peak of a sweep less height of the face, by the wavefront error alone."""

    um: float = 0.0
    half_width_um: float = 0.0  # of 95 %, by what neither workcell nor images know


def sweep_bias(
    case: LookCase, stated: WavefrontSpec, focus_um: Sequence[float], radius_um: float
) -> SweepBias:
    """Return the bias of a sweep over a look's target, by images through its lens.

    Only what the wavefront does is in it: the peak of the same look without one, which
    neighbours and their shade may move, is taken off. Where the sweep has no peak
    through the lens, half of it is the half-width.

    Parameters
    ----------
    case : LookCase
        The look, focused on the face.
    stated : WavefrontSpec
        What is known of the wavefront.
    focus_um : (N,) sequence of float
        World heights of the stops.
    radius_um : float
        Edges about this radius are scored; 0: all.
    """
    known, unknown = stated.known, unknown_focusing(stated)
    if not (known or unknown):
        return SweepBias()
    nearest = sorted(focus_um, key=lambda z: abs(z - case.focus_um))[:_STOPS]
    stops, tried = tuple(sorted(nearest)), as_tried(case)

    @cache
    def peak_um(terms: Terms, turn_rad: float = 0.0) -> float:
        seen = replace(tried, microscope=replace(case.microscope, wavefront=terms))
        found = focus_peak_um(seen, stops, radius_um=radius_um, turn_rad=turn_rad)
        return math.nan if found is None else found

    turns = _turns_rad(case, known)
    offs = np.array([peak_um(known, turn) - peak_um((), turn) for turn in turns])
    moved = [
        half / step * (peak_um(_changed(known, noll, step)) - peak_um(known))
        for noll, half in unknown.items()
        for step in [min(half, _STEP)]
    ]
    half_um = math.hypot(*moved, _swing_um(offs), _IMAGED * float(offs.mean()))
    if math.isnan(half_um):
        return SweepBias(half_width_um=(max(focus_um) - min(focus_um)) / 2)
    return SweepBias(um=float(offs.mean()), half_width_um=half_um)


def _changed(terms: Terms, noll: int, by_waves: float) -> Terms:
    """Return a wavefront error with one term larger."""
    found = dict(terms)
    found[noll] = found.get(noll, 0.0) + by_waves
    return tuple(sorted(found.items()))


def focus_peak_um(
    case: LookCase,
    focus_um: Sequence[float],
    *,
    radius_um: float,
    turn_rad: float = 0.0,
) -> float | None:
    """Return where a sweep over a look's images without noise peaks, um.

    By the measure and the fit of a run.

    Parameters
    ----------
    case : LookCase
        The look, through its microscope's wavefront error.
    focus_um : (N,) sequence of float
        World heights of the stops, strictly rising.
    radius_um : float
        Edges about this radius from the target's point are scored; 0: all.
    turn_rad : float
        By which the target is turned off its nominal angle.

    Returns
    -------
    float, optional
        None where the sweep has no peak.
    """
    at, radius_px = case.target, radius_um / case.microscope.um_per_px
    moved, scores = moved_layers(case, 0.0, 0.0, turn_rad), []
    for stop_um in focus_um:
        seen = replace(case, focus_um=stop_um)
        image = render_look(seen, moved, fresh(seen, seen.static))
        scores.append(face_sharpness(image, at.column, at.row, radius_px))
    found = mirror_peak(focus_um, scores)
    return None if isinstance(found, Failure) else found.z_um


def _turns_rad(case: LookCase, known: Terms) -> tuple[float, ...]:
    """Return by how much the target turns: at any angle astigmatism moves otherwise."""
    astigmatic = any(turns_of(noll) == 2 for noll, _ in known)
    return _TURNS_RAD if case.theta_any and astigmatic else (0.0,)


def _swing_um(offs: FloatArray) -> float:
    """Return the amplitude of what goes as twice the angle, from its quarters, (4,)."""
    return float(abs(offs @ _QUARTERS)) / 2 if len(offs) > 1 else 0.0
