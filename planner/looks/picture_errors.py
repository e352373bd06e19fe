"""What real pictures add to a look's images, and how far that moves its answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from microplan.featuresel.look.discrepancy import Discrepancy
from microplan.featuresel.look.nominal import target_contrast
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.ledger import NM
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.store.memo import Memo
from microplan.planner.task.workcell import DiscrepancyShares, Workcell
from microplan.schemas import plan as p

CODE = "MP504"
EFFECT = "discrepancy of real pictures"
_NM_PER_UM = 1000.0


def discrepancy(cell: Workcell, case: LookCase, memo: Memo) -> Discrepancy | None:
    """Return how far a look's pictures are from its images; None: not at all."""
    stated, scope = cell.discrepancy, case.microscope
    if stated.edge == stated.flat == stated.pixel == 0:
        return None
    step = memo.call(target_contrast, replace(case, discrepancy=None))
    fine_um = scope.wavelength_um / scope.aperture
    return Discrepancy(
        edge=stated.edge,
        flat=stated.flat,
        pixel=stated.pixel * step,
        fine_um=fine_um,
        size_um=max(case.target.size_um, fine_um),
    )


def picture_rows(
    cell: Workcell, case: LookCase, known: p.Repeatability | None
) -> tuple[p.EffectRow, ...]:
    """Return the ledger's row of what real pictures move a look's answer by.

    None where that is not known.
    """
    if case.discrepancy is None or known is None or known.trueness_um is None:
        return ()
    return (
        p.EffectRow(
            effect=EFFECT,
            level="drawn in trials",
            predicted_error=_NM_PER_UM * known.true_um,
            limit=_NM_PER_UM * case.tolerance_um,
            unit=NM,
            reason=f"one sigma: {stated_words(cell.discrepancy)}",
        ),
    )


def stated_words(stated: DiscrepancyShares) -> str:
    """Return a workcell's discrepancy in words."""
    told = "as stated" if stated.is_stated else "usual values, none is stated"
    return (
        f"{told}: edges {stated.edge:g} of their step, faces {stated.flat:g} of their "
        f"light, pixels {stated.pixel:g} of the target's step"
    )


def report_trueness(
    cell: Workcell, where: Span, looks: Sequence[p.Look], report: Report
) -> None:
    """Report by how much real pictures move looks, where that is not calibrated."""
    if cell.discrepancy.is_stated:
        return
    known = [(look.id, look.repeatability) for look in looks]
    told = [
        f"{name} {each.true_um:.2g}"
        for name, each in known
        if each is not None and each.true_um > 0
    ]
    if not told:
        return
    report.fact(
        CODE,
        where,
        f"discrepancy of pictures ({stated_words(cell.discrepancy)}): by it alone "
        f"looks err by so many um, one sigma, however often they repeat: "
        f"{', '.join(told)}",
        "microplan calibrate finds `discrepancy` in pictures of a part whose drawing "
        "is known, at six places or more",
    )
