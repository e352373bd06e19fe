"""How well a height is found by focus: all measures and fits, and planned sweeps.

python -m benchmarks.focus.sweeps prints the tables of docs/focus.md.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.focus.measures import FITS, MEASURE, MEASURES
from benchmarks.focus.truth import LAWS, PARTS, SENSOR, limit_um, noisy, still, sweep
from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import CameraNoise, Failure
from microplan.featuresel.routines.focus.peak import (
    FocusPeak,
    mirror_error_um,
    mirror_peak,
)
from microplan.featuresel.routines.focus.sweep import (
    FocusCurve,
    Sweep,
    focus_curve,
    plan_sweep,
)

STEPS_UM = (5, 2)
FIT = "mirror"  # the default
SWEEPS, DRAWS = 48, 4  # scenes a table, and noisy sweeps of each
RANGE_UM = 30.0  # either side of the height
CURVES = ("tenengrad", "brenner", "vollath_f4")  # squared gradients
MAGNIFICATIONS = (6.9, 20.0)
WANTED_NM = (30, 10, 5)  # of planned sweeps
WITHIN_UM = 10.0
PLANNED = 100  # sweeps of each plan
_SEED = 31
_FAR_UM, _FINE_UM = 40.0, 1.0  # of the sweeps whose maxima are counted
_COARSE = 1.15  # widths: the coarsest step that the mirror's error is stated for


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What one fit made of a measure's sweeps."""

    errors_um: FloatArray  # of those that answered
    sigmas_um: FloatArray  # the fit's own
    refused: int

    @property
    def rms_nm(self) -> float:
        """Return the rms error, bias included; nan if nothing answered."""
        if not len(self.errors_um):
            return math.nan
        return 1e3 * math.sqrt(float(np.mean(self.errors_um**2)))

    @property
    def refused_share(self) -> float:
        """Return how many sweeps were refused."""
        return self.refused / (self.refused + len(self.errors_um))

    @property
    def squared(self) -> float:
        """Return the mean squared error over the fit's own variance."""
        return float(np.mean((self.errors_um / self.sigmas_um) ** 2))


def parabola(z_um: FloatArray, scores: FloatArray) -> FocusPeak:
    """Return the top of the parabola through the highest stop and its neighbours.

    The control: it never refuses, and knows no spread.
    """
    i = int(np.clip(np.argmax(scores), 1, len(scores) - 2))
    a, b, c = scores[i - 1 : i + 2]
    step = z_um[i + 1] - z_um[i]
    top = z_um[i] + step * (a - c) / (2 * (a - 2 * b + c))
    return FocusPeak(z_um=float(top), sigma_um=step, width_um=step)


@cache
def rows(name: str, step_um: int) -> dict[tuple[str, str], Row]:
    """Return what every fit makes of every measure, by (measure, fit)."""
    rng = np.random.default_rng([_SEED, step_um, *name.encode()])
    fits = {**FITS, "parabola": parabola}
    found: dict[tuple[str, str], list[FocusPeak | Failure]] = {}
    for k in range(SWEEPS):
        z = np.arange(-RANGE_UM, RANGE_UM + step_um / 2, step_um)
        z += rng.uniform(-0.5, 0.5) * step_um
        images = sweep(PARTS[name], z, LAWS[k % len(LAWS)], rng)
        for _ in range(DRAWS):
            seen = [noisy(image, rng) for image in images]
            for measure, score in MEASURES.items():
                s = np.array([score(image, None) for image in seen])
                known = partial(mirror_peak, noise=curve(name).noise)
                for fit, peak in fits.items():
                    asked = known if (measure, fit) == (MEASURE, FIT) else peak
                    found.setdefault((measure, fit), []).append(asked(z, s))
    return {key: _row(peaks) for key, peaks in found.items()}


def _row(peaks: list[FocusPeak | Failure]) -> Row:
    """Return peaks as errors: the truth is 0."""
    good = [p for p in peaks if isinstance(p, FocusPeak)]
    return Row(
        errors_um=np.array([p.z_um for p in good]),
        sigmas_um=np.array([p.sigma_um for p in good]),
        refused=len(peaks) - len(good),
    )


@cache
def limit_nm(name: str, step_um: int) -> float:
    """Return the Cramer-Rao limit of a sweep, the rms over four sub-step offsets."""
    stops = np.arange(-RANGE_UM, RANGE_UM + step_um / 2, step_um)
    offsets = (np.arange(4) + 0.5) / 4 - 0.5
    limits = [limit_um(PARTS[name], stops + o * step_um) for o in offsets]
    return 1e3 * math.sqrt(float(np.mean(np.square(limits))))


@cache
def shapes(name: str) -> dict[str, tuple[float, float]]:
    """Return per measure the range ratio and the number of maxima under noise."""
    rng = np.random.default_rng([_SEED, 1, *name.encode()])
    z = np.arange(-_FAR_UM, _FAR_UM + _FINE_UM / 2, _FINE_UM)
    found: dict[str, list[tuple[float, float]]] = {m: [] for m in MEASURES}
    for k in range(8):
        images = sweep(PARTS[name], z + rng.uniform(-0.5, 0.5), LAWS[k % 2], rng)
        seen = [noisy(image, rng) for image in images]
        for measure, score in MEASURES.items():
            s = np.array([score(image, None) for image in seen])
            inner = (s[1:-1] > s[:-2]) & (s[1:-1] > s[2:])
            found[measure].append((float(s.max() / s.min()), float(inner.sum())))
    return {
        measure: (
            float(np.median([r for r, _ in each])),
            float(np.mean([n for _, n in each])),
        )
        for measure, each in found.items()
    }


def undrawn_ratio() -> float:
    """Return the mirror's worst error without noise over what is stated of it.

    Of squared gradients, over steps up to 1.15 widths, the rms over the stops' offsets.
    """
    z = np.arange(-_FAR_UM, _FAR_UM + 0.25, 0.5)
    worst = 0.0
    for part, law, m in itertools.product(PARTS.values(), LAWS, MAGNIFICATIONS):
        images = still(part, z, law=law, magnification=m)
        for measure in CURVES:
            s = np.array([MEASURES[measure](image, None) for image in images])
            worst = max(worst, *_undrawn(z, s))
    return worst


def _undrawn(z: FloatArray, s: FloatArray) -> Iterator[float]:
    """Yield rms error over what is stated, for each step of a finely drawn curve."""
    for every in range(2, 24):
        found = [mirror_peak(z[o::every], s[o::every]) for o in range(every)]
        good = [p for p in found if isinstance(p, FocusPeak)]
        width = float(np.mean([p.width_um for p in good])) if good else 0.0
        step = every * float(z[1] - z[0])
        if len(good) < every or step > _COARSE * width:
            return
        rms = math.sqrt(float(np.mean([p.z_um**2 for p in good])))
        yield rms / mirror_error_um(step, width)


@cache
def curve(name: str) -> FocusCurve:
    """Return the default measure's curve on a part, from the compiler's blur law."""
    z = np.arange(-RANGE_UM, RANGE_UM + 0.5, 1.0)
    camera = CameraNoise(
        full_well_e=SENSOR.full_well_e,
        read_noise_e=SENSOR.read_noise_e,
        bits=SENSOR.bits,
        fill_factor=1.0,
    )
    found = focus_curve(
        tuple(z),
        still(PARTS[name], z, law="hopkins"),
        MEASURES[MEASURE],
        camera,
        np.random.default_rng(_SEED),
    )
    assert isinstance(found, FocusCurve), found
    return found


def planned(name: str, wanted_nm: int) -> tuple[Sweep, Row]:
    """Return the cheapest sweep for a wanted sigma, and what it measures in truth."""
    plan = plan_sweep(
        curve(name), expected_um=0.0, within_um=WITHIN_UM, sigma_um=wanted_nm / 1e3
    )
    assert isinstance(plan, Sweep), plan
    rng = np.random.default_rng([_SEED, wanted_nm, *name.encode()])
    score, peaks = MEASURES[MEASURE], list[FocusPeak | Failure]()
    for k in range(PLANNED):
        off = rng.uniform(-WITHIN_UM, WITHIN_UM)  # the part is there, not at 0
        z = np.array(plan.focus_um) - off
        images = sweep(PARTS[name], z, LAWS[k % len(LAWS)], rng)
        scores = [
            float(np.mean([score(noisy(i, rng), None) for _ in range(plan.frames)]))
            for i in images
        ]
        noise = curve(name).noise / math.sqrt(plan.frames)
        peaks.append(mirror_peak(z, scores, noise=noise))
    return plan, _row(peaks)


def _measure(_: Options) -> Iterator[Figure]:
    """Yield errors, refusals, shapes of the curves and what planned sweeps keep."""
    for name in PARTS:
        for step in STEPS_UM:
            at, found = f"focus.{name}.{step}um", rows(name, step)
            limit = limit_nm(name, step)
            for measure in MEASURES:
                share = found[measure, FIT].refused_share
                yield Figure(name=f"{at}.{measure}.refused", value=share, unit="1")
            for fit in (*FITS, "parabola"):
                yield Figure(
                    name=f"{at}.{fit}_nm",
                    value=found[MEASURE, fit].rms_nm,
                    unit="nm",
                    floor=limit,
                )
            squared = found[MEASURE, FIT].squared
            yield Figure(name=f"{at}.squared_error", value=squared, unit="1")
        for measure, (ratio, maxima) in shapes(name).items():
            yield Figure(name=f"focus.{name}.{measure}.range", value=ratio, unit="1")
            yield Figure(name=f"focus.{name}.{measure}.maxima", value=maxima, unit="1")
        for wanted in WANTED_NM:
            plan, row = planned(name, wanted)
            at = f"focus.{name}.planned_{wanted}nm"
            ratio = row.rms_nm / (1e3 * plan.sigma_um)
            yield Figure(name=f"{at}.ratio", value=ratio, unit="1")
            yield Figure(name=f"{at}.images", value=plan.images, unit="1")
    yield Figure(name="focus.mirror.undrawn_ratio", value=undrawn_ratio(), unit="1")


def _names() -> Iterator[str]:
    """Yield the figures' names in their order."""
    for name in PARTS:
        for step in STEPS_UM:
            at = f"focus.{name}.{step}um"
            yield from (f"{at}.{measure}.refused" for measure in MEASURES)
            yield from (f"{at}.{fit}_nm" for fit in (*FITS, "parabola"))
            yield f"{at}.squared_error"
        for measure in MEASURES:
            yield from (f"focus.{name}.{measure}.{k}" for k in ("range", "maxima"))
        for wanted in WANTED_NM:
            at = f"focus.{name}.planned_{wanted}nm"
            yield from (f"{at}.{what}" for what in ("ratio", "images"))
    yield "focus.mirror.undrawn_ratio"


BENCHMARK = Benchmark(names=tuple(_names()), measure=_measure)


def _tables() -> Iterator[str]:
    """Yield the page's tables, line by line."""
    fits = (*FITS, "parabola")
    for name in PARTS:
        for step in STEPS_UM:
            limit = limit_nm(name, step)
            yield f"\n{name}, stops {step} um apart, limit {limit:.1f} nm\n"
            yield "| measure | " + " | ".join(f"{f} nm" for f in fits) + " | refused |"
            yield "|---|" + "---|" * (len(fits) + 1)
            found = rows(name, step)
            for measure in MEASURES:
                cells = [f"{found[measure, fit].rms_nm:.1f}" for fit in fits]
                share = found[measure, FIT].refused_share
                yield f"| {measure} | {' | '.join(cells)} | {share:.0%} |"
        yield f"\n{name}, 1 um apart over {2 * _FAR_UM:g} um\n"
        yield "| measure | highest / lowest | maxima |\n|---|---|---|"
        for measure, (ratio, maxima) in shapes(name).items():
            yield f"| {measure} | {ratio:.2g} | {maxima:.3g} |"
        yield f"\n{name}, planned: {curve(name)}\n"
        yield "| wanted nm | stops | step um | frames | predicted nm | measured nm |"
        yield "|---|---|---|---|---|---|"
        for wanted in WANTED_NM:
            plan, row = planned(name, wanted)
            step_um = plan.focus_um[1] - plan.focus_um[0]
            yield (
                f"| {wanted} | {len(plan.focus_um)} | {step_um:.2f} | {plan.frames} | "
                f"{1e3 * plan.sigma_um:.1f} | {row.rms_nm:.1f} |"
            )
    yield f"\nundrawn ratio {undrawn_ratio():.2f}"
    for name in PARTS:
        for step in STEPS_UM:
            row = rows(name, step)[MEASURE, FIT]
            yield f"{name} {step} um: squared error over variance {row.squared:.2f}"


if __name__ == "__main__":
    for line in _tables():
        print(line, flush=True)
    sys.exit(0)
