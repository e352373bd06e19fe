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
# What is tried where none is stated: as much as the pictures have by which gates are
# judged (`benchmarks/real`), and twice as wide as the lens shows a point.
MOST_SHARE, RADIUS = 0.1, 2.0  # of all light; wavelengths over A


def halo_ends(
    stated: HaloSpec | None, microscope: Microscope
) -> tuple[Halo | None, ...]:
    """Return the halo that is stated, or both ends of what may be."""
    if stated is not None:
        return ((stated.radius_um, stated.share),)
    radius_um = RADIUS * microscope.wavelength_um / microscope.aperture
    return None, (radius_um, MOST_SHARE)


def halo_row(stated: HaloSpec | None, limit: float) -> EffectRow:
    """Return the row of the halo, before it is charged."""
    if stated is None:
        reason = f"not stated; up to {MOST_SHARE:.0%} of all light (state `halo`)"
    elif stated.share > 0:
        reason = f"stated: {stated.share:.2g} of all light"
    else:
        reason = "none is stated"
    is_off = stated is not None and stated.share == 0
    return EffectRow(
        effect=HALO,
        level="off" if is_off else "not modelled",
        predicted_error=0.0 if is_off else None,
        limit=limit,
        unit=CONTRAST,
        reason=reason,
    )
