"""One entry of the list of extreme points, as it is kept."""

from __future__ import annotations

from typing import Any

from tests.optics.extremes.high_precision import Number, mpmath

Entry = dict[str, Any]

ROUNDING = 1e-14  # of a value about 1: a few dozen operations
# Image errors that the renderer allows itself: band 5e-4, margin 8e-4, table 2e-5.
RENDERED = 1.4e-3


def entry(
    call: str, expected: Number, allowed: float, source: str, **given: object
) -> Entry:
    """Return one point as it is kept; the value with 17 digits."""
    mp = mpmath()
    text = mp.nstr(mp.mpf(expected), 17)
    return {
        "call": call,
        "given": given,
        "expected": text,
        "allowed": float(f"{allowed:.2g}"),
        "source": source,
    }
