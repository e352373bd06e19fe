"""Angle of a toothed part: the phase of its teeth, then the notch selects which one."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)
from microplan.featuresel.routines.sampling import cubic

_SAMPLES = 40  # per tooth pitch: the harmonic's aliases are far away
_IN_VIEW = 0.6  # of the tooth ring must be inside the image
_TEETH_LEAST = 0.01  # amplitude of the teeth's harmonic, full scale
_TEETH_PART = 0.3  # of the predicted amplitude
_TEETH_NOISE = 5.0  # standard errors the harmonic must stand out by
_NOTCH_LEAST = 0.02  # height of the notch's signal, full scale
_NOTCH_PART = 0.4  # of the predicted height
_RUNNER_UP = 0.6  # of the best candidate's signal, the most the second may reach


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the rings to read, and phase, sign and height of both patterns there.

    The phase is calibrated on the image, so a contrast reversal by defocus is allowed
    for at the nominal focus; beyond it the notch falls between two candidates.
    """
    p = target.parameters
    if "notch_rad" not in p:
        return Failure("no_notch", "nothing tells one tooth from the next")
    k = target.px_per_um
    half = p["notch_width_um"] / p["notch_radius_um"] / 2
    first = Artifact(
        parameters={
            "count": p["count"],
            "root_px": p["root_um"] * k,
            "outer_px": p["outer_um"] * k,
            "notch_radius_px": p["notch_radius_um"] * k,
            "notch_half_rad": half,
            "range_rad": target.theta_range_rad,
        }
    )
    image, at = render(), Guess(column=target.column, row=target.row)
    teeth = _teeth(image, first, at)
    if isinstance(teeth, Failure):
        return teeth
    phase, amplitude, _ = teeth
    expected = target.theta_rad + p["notch_rad"]
    signal = float(_notch_signal(image, first, at, np.array([expected]))[0])
    if amplitude < _TEETH_LEAST:
        return Failure("no_teeth", f"predicted amplitude {amplitude:.4f}")
    if not abs(signal) > _NOTCH_LEAST:
        return Failure("no_notch", f"predicted signal {signal:.4f}")
    return Artifact(
        parameters={
            **first.parameters,
            "phase_rad": phase - target.theta_rad,
            "amplitude": amplitude,
            "notch_rad": p["notch_rad"],
            "notch_signal": signal,
        }
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the angle in `image`, (rows, columns) 0..1, at the guess's position."""
    p = artifact.parameters
    teeth = _teeth(image, artifact, guess)
    if isinstance(teeth, Failure):
        return teeth
    phase, amplitude, error = teeth
    if amplitude < max(_TEETH_PART * p["amplitude"], _TEETH_NOISE * error):
        return Failure(
            "no_teeth",
            f"amplitude {amplitude:.4f} (error {error:.4f}), "
            f"predicted {p['amplitude']:.4f}",
        )
    pitch = 2 * math.pi / p["count"]
    angles = phase - p["phase_rad"] + pitch * np.arange(p["count"], dtype=np.float64)
    chosen = _choose(image, artifact, guess, angles)
    if isinstance(chosen, Failure):
        return chosen
    theta, clearness = chosen
    theta = math.remainder(theta, 2 * math.pi)
    nominal = theta if guess.theta_rad is None else guess.theta_rad
    turned = abs(math.remainder(theta - nominal, 2 * math.pi))
    if p["range_rad"] < math.pi and turned > p["range_rad"] + pitch / 4:
        return Failure("outside", f"turned by {turned:.3f} rad")
    return Measurement(
        column=guess.column,
        row=guess.row,
        theta_rad=theta,
        score=clearness,
        spread_px=0.0,
    )


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    p = artifact.parameters
    ring = _SAMPLES * p["count"]
    radii = max(5, int(2 * (p["outer_px"] - p["root_px"])) + 1)
    teeth = work.read(ring * radii) + work.least_squares(ring, 9)
    return teeth + 3 * work.read(p["count"] * 7 * 3) + 0.5


TOOTH_NOTCH = Routine(
    name="tooth_notch",
    version="1",
    kinds=("teeth",),
    principle="edges",
    provides=("theta",),
    requires=("xy",),
    capture_px=2.0,
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _teeth(
    image: FloatArray, artifact: Artifact, at: Guess
) -> tuple[float, float, float] | Failure:
    """Return angle of a tooth's middle, amplitude and the amplitude's error."""
    p = artifact.parameters
    count = int(p["count"])
    angles = np.linspace(0, 2 * math.pi, _SAMPLES * count, endpoint=False)
    # as far inside the root as outside the tips: what is defocused spreads both ways
    depth = p["outer_px"] - p["root_px"]
    radii = np.linspace(p["root_px"], p["outer_px"], max(5, int(2 * depth) + 1))
    ring, inside = _ring(image, at, angles, radii)
    if inside.mean() < _IN_VIEW:
        return Failure("outside", f"{inside.mean():.0%} of the teeth are in view")
    orders = (1, 2, 3, count)
    waves = [f(n * angles) for n in orders for f in (np.cos, np.sin)]
    design = np.column_stack((np.ones_like(angles), *waves))[inside]
    solved, *_ = np.linalg.lstsq(design, ring[inside], rcond=None)
    a, b = float(solved[-2]), float(solved[-1])
    # higher tooth harmonics are in the residual too: the error is on the safe side
    rms = float(np.std(ring[inside] - design @ solved))
    error = rms * math.sqrt(2 / (inside.sum() / 4))  # 4 samples are one pixel or less
    return math.atan2(b, a) / count, math.hypot(a, b), error


def _choose(
    image: FloatArray, artifact: Artifact, at: Guess, angles: FloatArray
) -> tuple[float, float] | Failure:
    """Return the one of the part angles that the notch confirms, and how clearly."""
    p = artifact.parameters
    signal = _notch_signal(image, artifact, at, angles + p["notch_rad"])
    known = np.isfinite(signal)
    signal = np.where(known, signal, 0.0) * math.copysign(1.0, p["notch_signal"])
    order = np.argsort(-signal, kind="stable")
    best, second = float(signal[order[0]]), max(float(signal[order[1]]), 0.0)
    if best < max(_NOTCH_PART * abs(p["notch_signal"]), _NOTCH_LEAST / 2):
        return Failure(
            "no_notch", f"signal {best:.4f}, predicted {abs(p['notch_signal']):.4f}"
        )
    if second > _RUNNER_UP * best:
        return Failure(
            "ambiguous", f"notch signals {best:.4f} and {second:.4f} are too close"
        )
    return float(angles[order[0]]), 1 - second / best


def _notch_signal(
    image: FloatArray, artifact: Artifact, at: Guess, middles: FloatArray
) -> FloatArray:
    """Return brightness at each angle against its two sides; nan where out of view."""
    p = artifact.parameters
    half = p["notch_half_rad"]
    inner = np.linspace(-0.7, 0.7, 7) * half  # corners are blurred: stay off them
    radii = p["notch_radius_px"] + np.linspace(-1.0, 1.0, 3)

    def mean(shift: float) -> FloatArray:
        angles = (middles[:, None] + shift + inner).ravel()
        ring, inside = _ring(image, at, angles, radii)
        whole = inside.reshape(len(middles), -1).all(axis=1)
        value: FloatArray = ring.reshape(len(middles), -1).mean(axis=1)
        return np.where(whole, value, np.nan)

    return mean(0.0) - (mean(-2.5 * half) + mean(2.5 * half)) / 2


def _ring(
    image: FloatArray, at: Guess, angles: FloatArray, radii: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the mean over the radii at each angle, and whether all were in view."""
    values, inside = cubic(
        image,
        at.column + np.outer(np.cos(angles), radii),
        at.row - np.outer(np.sin(angles), radii),
    )
    mean: FloatArray = values.mean(axis=1)
    return mean, np.asarray(inside.all(axis=1))
