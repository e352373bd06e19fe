"""Coherence by settings of a condenser in words, and where readings contradict it."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.planner.calibration.condenser.condenser_fit import (
    USUAL,
    CondenserFit,
)
from microplan.planner.calibration.picture_intake import CODE
from microplan.planner.source.diagnostics import Report, Span

_APART = 3.0  # standard deviations
_OFF = 1.5  # times what images of a right lens are off by
_MATTERS = 0.03  # of a coherence: readings that are off by less are right


def condenser_words(
    fit: CondenserFit, first_aperture: float, *, scaled: bool
) -> Iterator[str]:
    """Yield what the numbers hold for, and what was tried besides.

    `scaled`: edges tell the drawing's scale.
    """
    yield f"coherence is that of the first row, a condenser of {first_aperture:.3g}"
    seen = [fit.coherence(s).value / s for s in fit.settings]
    if fit.each_its_own:
        shares = ", ".join(f"{each:.3f}" for each in seen)
        yield f"seen over read, by settings: {shares}: readings share no factor"
    else:
        yield f"seen over read: {seen[0]:.3f} at all settings"
    names = {"focus": "a defocus", "own": "a factor of each setting"}
    for name, share in fit.better.items():
        yield f"pictures left out err {share:.2g} of as much with {names[name]}"
    if fit.defocus > 0:
        words = "or the aperture is less than stated; that is accounted for"
        yield f"out of focus by {fit.waves:.2g} waves at the pupil's rim, {words}"
    yield f"profiles are off by {fit.rms:.2%} rms of the edge's step"
    yield f"amplitude around the part over its own: {fit.ratio.value:.4f}"
    if not scaled:
        yield (
            "one outline does not tell the drawing's scale: the own edge offset holds "
            "at the scale stated, coherence does not depend on it"
        )
    if fit.numbers.blocks < 2:
        yield "one place: whether readings share a factor is not told, it is assumed"


def stated_doubts(
    fit: CondenserFit, aperture: float, where: Span, report: Report
) -> None:
    """Report settings whose coherence is not what their readings say."""
    if fit.defocus < 0:
        message = "edges are sharper than images in focus"
        hint = "calibrate optics.numerical_aperture by focus steps first"
        report.warning(CODE, where, message, hint)
    elif fit.misfit > _OFF * USUAL:
        message = (
            f"images are off by {fit.misfit:.2%} of an edge's step, {USUAL:.1%} is "
        )
        message += "usual"
        if fit.offset_px.sigma is not None:
            message += ": the standard deviations are as much larger"
        hint = "are optics.numerical_aperture, camera.response and black_level right, "
        hint += "optics.wavefront that of the lens, the light below saturation?"
        report.warning(CODE, where, message, hint)
    far = []
    for setting in fit.settings:
        found = fit.coherence(setting)
        sure = found.sigma is None or abs(found.value - setting) > _APART * found.sigma
        if sure and abs(found.value - setting) > _MATTERS * setting:
            sigma = "" if found.sigma is None else f" +- {found.sigma:.2g}"
            read = f"{setting * aperture:.3g} means {setting:.3g}"
            far.append(f"{read}, seen is {found.value:.3g}{sigma}")
    if far:
        message = f"condenser_aperture contradicts the edges: {'; '.join(far)}"
        hint = "the scale of the condenser is off, or optics.numerical_aperture is"
        report.warning(CODE, where, message, hint)
