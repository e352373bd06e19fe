"""Displacement of a look's answer by a camera's response that is not stated.

Counts that follow a power of the light move the level half way up a blurred edge, of
all edges of one contrast alike. The chosen chain measures images so changed by both
ends of the powers, and what its answer moves by is a bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bias_prediction import PoseBias, predict_bias
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trials import Map, PreparedRoutines
from microplan.optics.ledger import NM
from microplan.optics.render.fidelity import rounded_up
from microplan.planner.looks.edge_shifts.coherence_shift import FINEST_NM, reach_um
from microplan.schemas.plan import EffectRow

# Exponents of the counts over light that a camera may have whose response is not
# stated: one that is corrected for a screen has .45, and most that measure have 1.
POWERS = (0.7, 1.4)
MOST_SHIFT = 0.08  # of wavelength over aperture, that the middle of an edge moves by
_POSES = 8  # a chain of whole pixels answers otherwise at each
_NM_PER_UM = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseShift:
    """Half-widths of the bias by an unknown response, about a straight one's answer."""

    um: float = 0.0
    rad: float = 0.0


NO_SHIFT = ResponseShift()


def response_shift(
    case: LookCase,
    prepared: PreparedRoutines,
    chain: Chain,
    *,
    root_seed: int,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> ResponseShift:
    """Return how far a response that is not stated may move the answer of a chain.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        With the chain's artifacts, made for counts in proportion to light.
    chain : tuple of str
        The chain.

    Notes
    -----
    Both powers are measured at the same poses as light itself; the larger difference
    counts, in full as a half-width. A chain that gives no right answer there is charged
    `MOST_SHIFT`, what an edge from black to white moves by, and the angle that it makes
    at the target's rim.
    """
    only = replace(prepared, chains=(chain,))

    def answer(power: float) -> PoseBias | None:
        found = predict_bias(
            case, only, poses=_POSES, root_seed=root_seed, power=power, map=map
        )
        return found.get(chain)

    plain = answer(1.0)
    most_um = MOST_SHIFT * case.microscope.wavelength_um / case.microscope.aperture
    moved_um, moved_rad = 0.0, 0.0
    for power in POWERS:
        there = answer(power)
        if plain is None or there is None:
            moved_um = max(moved_um, most_um)
            moved_rad = max(moved_rad, most_um / max(reach_um(case), most_um))
            continue
        x, y, theta = (b - a for a, b in zip(plain, there, strict=True))
        moved_um = max(moved_um, math.hypot(x, y))
        moved_rad = max(moved_rad, abs(theta))
    return ResponseShift(um=moved_um, rad=moved_rad)


def response_rows(
    case: LookCase, shift: ResponseShift, *, is_stated: bool
) -> tuple[EffectRow, ...]:
    """Return the ledger's row of what a response may move, none of a stated one."""
    if is_stated:
        return ()
    low, high = POWERS
    return (
        EffectRow(
            effect="target moved by the camera's response",
            level="charged",
            predicted_error=rounded_up(_NM_PER_UM * shift.um, FINEST_NM),
            limit=_NM_PER_UM * case.tolerance_um,
            unit=NM,
            reason=f"response not stated: the chain measured counts that follow light "
            f"to the powers {low:g} and {high:g}",
        ),
    )
