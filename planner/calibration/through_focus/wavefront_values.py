"""A lens with its aberrations as workcell lines, and in words."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    PictureSource,
)
from microplan.planner.calibration.through_focus.wavefront_fit import (
    WavefrontFit,
    WavefrontTerm,
)

_WHERE = ("optics", "wavefront")
_NAMES = {
    5: "astigmatism at 45 deg", 6: "astigmatism along x", 7: "coma along y",
    8: "coma along x", 9: "trefoil along y", 10: "trefoil along x",
    11: "spherical aberration", 22: "spherical aberration of the next order",
}  # fmt: skip


def wavefront_values(
    fit: WavefrontFit, source: PictureSource, *, has_rms: bool
) -> Iterator[CalibratedValue]:
    """Yield the terms that are told as one table, if there are any.

    With `has_rms` the workcell states all aberrations together, and has no room.
    """
    if not fit.terms:
        return
    terms = sorted(fit.terms, key=lambda term: term.noll)
    yield CalibratedValue(
        key="wavefront",
        value=tuple((float(t.noll), t.waves.value) for t in terms),
        sigma=tuple(term.waves.sigma for term in terms),
        unit="Noll index, waves rms",
        method=terms[0].waves.method,
        source=source,
        where=None if has_rms else _WHERE,
        text="[" + ", ".join(map(_line, terms)) + "]",
    )


def _line(term: WavefrontTerm) -> str:
    """Return a term as a workcell has it."""
    waves = f"waves: {term.waves.value:.5f}, sigma_waves: {term.waves.sigma or 0:.5f}"
    return f"{{noll: {term.noll}, {waves}}}"


def wavefront_words(fit: WavefrontFit, *, has_rms: bool) -> Iterator[str]:
    """Yield which aberrations are there, and which are not told from none."""
    for term in sorted(fit.terms, key=lambda term: term.noll):
        found = f"{_NAMES[term.noll]} (Noll {term.noll}): {_waves(term)} waves rms"
        yield f"{found}; steps left out err {term.better:.2g} of as much with it"
    if fit.terms and has_rms:
        yield "optics.wavefront_rms is stated: put the terms in its place"
    if fit.dropped:
        each = (f"Noll {term.noll} {_waves(term)}" for term in fit.dropped)
        yield f"not told from none, waves rms: {', '.join(each)}"


def _waves(term: WavefrontTerm) -> str:
    return f"{term.waves.value:+.4f} +- {term.waves.sigma or 0:.4f}"
