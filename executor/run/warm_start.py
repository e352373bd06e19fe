"""Warm start of a look: where features must be after a correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from microplan.arrays import Point
from microplan.featuresel.routines.chain import HANDOVER_SIGMAS
from microplan.featuresel.routines.contract import Guess, Measurement
from microplan.featuresel.routines.registry import load
from microplan.schemas.plan import RoutineUse

# A fit, and its one linear step: they read the same arrays and end at the same pose.
FIT, STEP = "likelihood", "one_step"


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFeature:
    """A feature as the look before found it."""

    x_um: float  # world, the routine's mean error taken off
    y_um: float
    pixels: Measurement  # in the region of that look
    bias_px: Point  # of these from its place, (column, row): the routine's mean error


@dataclass(frozen=True, slots=True, kw_only=True)
class WarmStart:
    """Warm start of a look: features found before, with sigma of the move since."""

    features: Mapping[str, FoundFeature]
    sigma_um: float  # of a feature's position now, per axis


def nearest_routine(
    uses: Sequence[RoutineUse],
    warm_start: WarmStart,
    before: FoundFeature,
    um_per_px: float,
) -> str | None:
    """Return the routine that may start where a feature must be, None for the chain.

    The same share of its capture range as for a hand-over within a chain.
    """
    if not uses or uses[-1].id != FIT:
        return None
    reach_px = HANDOVER_SIGMAS * warm_start.sigma_um / um_per_px
    known = before.pixels.z_um is not None
    for name in (STEP, FIT) if known else (FIT,):
        if reach_px <= load(name).capture_px:
            return name
    return None


def guess_from(
    before: FoundFeature,
    now_px: Point,
    theta_rad: float,
) -> Guess:
    """Return the first guess of a feature after a correction.

    Parameters
    ----------
    before : FoundFeature
        What the look before found.
    now_px : (column, row)
        Of the feature's believed position, in the region that is read now.
    theta_rad : float
        The angle that it must have now; used if the look before measured one.
    """
    return Guess(
        column=now_px[0] + before.bias_px[0],
        row=now_px[1] + before.bias_px[1],
        theta_rad=None if before.pixels.theta_rad is None else theta_rad,
        z_um=before.pixels.z_um,
        zoom=before.pixels.zoom,
    )
