"""Wavefront error of an objective from a workcell file, as typed values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from microplan.planner.task.workcell import WavefrontSpec, ZernikeTerm


def read_wavefront(raw: Mapping[str, Any]) -> WavefrontSpec:
    """Return the wavefront error that an `optics` section states, terms by index."""
    rows, rms = raw.get("wavefront"), raw.get("wavefront_rms")
    terms = None
    if rows is not None:
        found = (
            ZernikeTerm(
                noll=int(row["noll"]),
                waves=float(row["waves"]),
                sigma_waves=float(row["sigma_waves"]),
            )
            for row in rows
        )
        terms = tuple(sorted(found, key=lambda term: term.noll))
    return WavefrontSpec(terms=terms, rms_waves=None if rms is None else float(rms))
