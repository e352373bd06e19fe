"""Halos that an objective may have: light scattered wider than the lens shows a point.

Both sides of an edge get the same of it, so that edges stay; where other light lies
near, or a target is as small as the halo, answers move.
"""

from __future__ import annotations

from microplan.optics.ledger import CONTRAST
from microplan.optics.transfer.microscope import Halo, Microscope
from microplan.planner.task.workcell import HaloSpec
from microplan.schemas.plan import EffectRow

HALO = "halo"
# levels: trials have it, within 2 % of what it changes, or they lack it
IMAGED, LACKING = "imaged", "not modelled"
# What is tried where none is stated: as much as the pictures have by which gates are
# judged (`benchmarks/real`), and twice as wide as the lens shows a point.
MOST_SHARE, RADIUS = 0.1, 2.0  # of all light; wavelengths over A


def halo_ends(microscope: Microscope) -> tuple[Halo | None, ...]:
    """Return both ends of what a halo that is not stated may be."""
    radius_um = RADIUS * microscope.wavelength_um / microscope.aperture
    return None, (radius_um, MOST_SHARE)


def halo_row(stated: HaloSpec | None, limit: float) -> EffectRow:
    """Return the row of the halo, before it is charged."""
    if stated is None:
        reason = f"not stated; up to {MOST_SHARE:.0%} of all light (state `halo`)"
        level = LACKING
    elif stated.share > 0:
        level, reason = IMAGED, f"stated: {stated.share:.2g} of all light"
    else:
        level, reason = "off", "none is stated"
    return EffectRow(
        effect=HALO,
        level=level,
        predicted_error=None if stated is None else 0.0,
        limit=limit,
        unit=CONTRAST,
        reason=reason,
    )
