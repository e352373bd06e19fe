"""Height of a face by focus: a sweep with its curve, or a pair of pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.measure_target import TargetSighting, light_of
from microplan.executor.run.run_context import Rig
from microplan.featuresel.routines.contract import Artifact, Failure, Guess
from microplan.schemas.plan import HeightSearch, Look

# A peak lower than this many times the scores' noise is none: of 20 stops of noise the
# highest is 3.7 above the lowest in half of all sweeps, 6.4 in one of 1000.
LEAST_HEIGHT = 8.0
_HALF = 1.96  # standard deviations of a two-sided 95 % half-width


@dataclass(frozen=True, slots=True, kw_only=True)
class SharpnessCurve:
    """Curve of a sweep: sharpness over focus."""

    focus_um: tuple[float, ...]
    scores: tuple[float, ...]
    noise: float  # standard deviation of a score, from stops that were taken twice


@dataclass(frozen=True, slots=True, kw_only=True)
class Height:
    """The height of a face, and how it is known; `curve` is None for a pair."""

    z_um: float
    sigma_um: float
    seconds: float  # from the first picture's order to the last picture
    curve: SharpnessCurve | None = None


def height_by_sweep(
    rig: Rig, search: HeightSearch, look: Look, part: TargetSighting
) -> Height:
    """Return the height at which the part's face is sharpest, um.

    Both ends of the sweep are taken twice, which gives the noise of a score. What the
    lens is known to move the peak by is off it, `unbiased`.

    Raises
    ------
    ExecutorError
        MP853, with the cause: "flat" (no peak exceeds the noise, or by too little),
        "border" (the peak is at an end of the sweep), "several_peaks", "coarse" or
        "few_stops".
    """
    began_s = rig.station.clock.now_s()
    scores, again = list[float](), list[float]()
    for number, focus_um in enumerate(search.focus_um, start=1):
        scores.append(_score_at(rig, search, look, part, focus_um))
        if number in (1, len(search.focus_um)):
            twice = _score_at(rig, search, look, part, focus_um)
            again.append(twice - scores[-1])
    # a difference has twice the variance of one score
    noise = math.sqrt(sum(d * d for d in again) / len(again) / 2)
    curve = SharpnessCurve(focus_um=search.focus_um, scores=tuple(scores), noise=noise)
    rig.journal.write("focus_curve", look=look.id, curve=curve)
    found = peak_of(curve, part.target, rig.station.clock.now_s() - began_s)
    return unbiased(found, search)


def peak_of(curve: SharpnessCurve, target: str, seconds: float = 0.0) -> Height:
    """Return the one true peak of a curve; MP853 if it has none."""
    # loads cv2, not needed at start
    from microplan.featuresel.routines.focus.peak import mirror_peak

    height = max(curve.scores) - min(curve.scores)
    if not height >= LEAST_HEIGHT * curve.noise:
        raise ExecutorError(
            "MP853",
            f"{target}: the sweep is flat: its scores span {height:.3g}, their noise "
            f"is {curve.noise:.3g}",
            cause="flat",
        )
    # two differences are too few for a standard deviation: it comes from the fit
    found = mirror_peak(curve.focus_um, curve.scores)
    if isinstance(found, Failure):
        raise ExecutorError(
            "MP853",
            f"{target}: no height between {min(curve.focus_um):g} and "
            f"{max(curve.focus_um):g} um ({found.code}): {found.message}",
            cause=found.code,
        )
    return Height(
        z_um=found.z_um, sigma_um=found.sigma_um, seconds=seconds, curve=curve
    )


def unbiased(peak: Height, search: HeightSearch) -> Height:
    """Return the height of the face whose image peaks there, by the plan's bias."""
    return replace(
        peak,
        z_um=peak.z_um - search.bias_um,
        sigma_um=math.hypot(peak.sigma_um, search.bias_half_width_um / _HALF),
    )


def height_by_pair(
    rig: Rig,
    look: Look,
    part: TargetSighting,
    artifact: Artifact,
    *,
    expected_um: float,
    offset_um: float,
) -> Height:
    """Return the height from one picture below and one above the expected focus.

    Parameters
    ----------
    artifact : Artifact
        By `microplan.featuresel.routines.likelihood.defocus_pair.prepare` for this
        look, at `offset_um`.
    expected_um : float
        World height of the face, nominally; where the artifact's focus is 0.
    offset_um : float
        Half the distance of the two pictures' focus.

    Raises
    ------
    ExecutorError
        MP853 if the pictures give no height.
    """
    from microplan.featuresel.routines.likelihood import defocus_pair

    began_s, offsets = rig.station.clock.now_s(), (-offset_um, offset_um)
    look, images = rig.placed(look), []
    for offset in offsets:
        rig.set_view(look.view, focus_um=expected_um + offset)
        counts = rig.grab(look.measure.region, keep=False)
        images.append(light_of(counts, rig.plan.requirements))
    seconds = rig.station.clock.now_s() - began_s
    column, row = rig.frame_of(look).to_pixel(part.x_um, part.y_um)
    guess = Guess(column=column, row=row, theta_rad=part.theta_rad)
    found = defocus_pair.measure(images, offsets, artifact, guess)
    if isinstance(found, Failure):
        raise ExecutorError(
            "MP853",
            f"{part.target}: no height from a pair ({found.code}): {found.message}",
            cause=found.code,
        )
    if found.z_um is None or found.spread_z_um is None:
        raise ExecutorError("MP853", f"{part.target}: the pair tells no height")
    # the fit gives the height of the focus above the face
    return Height(
        z_um=expected_um - found.z_um, sigma_um=found.spread_z_um, seconds=seconds
    )


def _score_at(
    rig: Rig, search: HeightSearch, look: Look, part: TargetSighting, focus_um: float
) -> float:
    """Return how sharp the part's edges are with the focus at `focus_um`."""
    # as above
    from microplan.featuresel.routines.focus.measures import face_sharpness

    rig.set_view(look.view, focus_um=focus_um)
    look = rig.placed(look)
    counts = rig.grab(look.measure.region, keep=False)  # mostly blurred
    image = light_of(counts, rig.plan.requirements)
    column, row = rig.frame_of(look).to_pixel(part.x_um, part.y_um)
    radius_px = search.ring_radius_um / look.view.um_per_px
    try:
        return face_sharpness(image, column, row, radius_px)
    except ValueError as error:  # black, or the ring is out of the picture
        raise ExecutorError("MP853", f"{part.target}: {error}") from error
