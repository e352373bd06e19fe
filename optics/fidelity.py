"""The effects ledger: which optical effect is modelled, at what level and cost."""

from __future__ import annotations

from dataclasses import dataclass


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
