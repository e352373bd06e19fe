"""The perturbation design of a look, and the image of any of its trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.stats import truncnorm

from featuresel.axes import corner, generator, interior
from featuresel.axes import words as words  # handed on: seeds are made of them
from featuresel.case import LookCase, moved_layers, picture
from featuresel.disturb import noisier, shifted, true_lens
from featuresel.standing import (
    CUT,
    Backdrop,
    displaced,
    fresh,
    standing,
    usual_range,
)
from optics.lens import LensErrors
from optics.microscope import Microscope
from optics.scene import Illumination, Layer
from optics.sensor import CountArray, expose, to_unit
from optics.views import Range

FloatArray = npt.NDArray[np.float64]

_EVERY = 4  # each fourth trial is an extreme, whatever their number
_CORNER = 2.0  # sigmas at the extremes, all at once: already far out together
MOST_TRIALS = 2**20  # more than any look gets
# The estimator's blur law must not always be the truth.
_OTHER_MODEL = {"hopkins": "stokseth", "exact": "stokseth"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One perturbed image of a look."""

    index: int
    dx_um: float  # of the target from nominal, world
    dy_um: float
    dtheta_rad: float
    dz_um: float  # of the focus from nominal
    magnification: float  # ratio to nominal
    gain: float  # times the nominal light
    gradient_x: float  # added to the nominal light's
    gradient_y: float
    model: str
    seed: tuple[int, ...]  # of the noise
    occluder_um: tuple[float, float] = (0.0, 0.0)  # of what is not the target's owner
    lens: LensErrors | None = None  # what it truly does; None: what is known of it
    noise: float = 1.0  # times the sensor's
    # by which each of the spread's `turning` is turned, rad
    turns_rad: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class _Rest:
    """The axes that most looks leave at rest, in units of their spreads."""

    occluder: Sequence[float]  # sigmas, 2
    lens: Sequence[float]  # sigmas, 6
    noise: float  # 0..1 of its interval


def design(case: LookCase, count: int, root_seed: int) -> tuple[Trial, ...]:
    """Return the first `count` trials of a look.

    Trial k depends on the case, `root_seed` and k alone: other routines, cases or
    counts change none. Three of four are scrambled Sobol points mapped to the spreads;
    each fourth is an extreme of a folded two-level design (2 sigma in focus, zoom and
    angle, the ends of the light's and the noise's intervals, nine tenths to all of
    `search_um`). A spread that is zero leaves its axis at rest and the others where
    they were.

    Parameters
    ----------
    case : LookCase
        The look.
    count : int
        How many, 1 to `MOST_TRIALS`.
    root_seed : int
        Root of all seeds, >= 0.

    Raises
    ------
    ValueError
        If `count` or `root_seed` is out of range.
    """
    if not 1 <= count <= MOST_TRIALS:
        raise ValueError(f"count must be in 1..{MOST_TRIALS}, got {count}")
    if root_seed < 0:
        raise ValueError(f"root_seed must not be negative, got {root_seed}")
    points = interior("design", case.key, root_seed, count)
    normal = _normal(points[:, :5])
    occluder, lens, noise = (
        interior(group, case.key, root_seed, count)
        for group in ("occluder", "lens", "noise")
    )
    resting = zip(_normal(occluder), _normal(lens), noise[:, 0], strict=True)
    rests = [_Rest(tuple(o), tuple(t), float(n)) for o, t, n in resting]
    found = []
    for index in range(count):
        turn, place_of = divmod(index, _EVERY)
        if place_of == _EVERY - 1:
            found.append(_extreme(case, index, turn, root_seed))
        else:
            row = index - turn
            at = normal[row], points[row], rests[row]
            found.append(_interior(case, index, *at, root_seed))
    return tuple(found)


def rebuild(case: LookCase, root_seed: int, index: int) -> Trial:
    """Return one trial of `design` by its number, such as a score's worst."""
    return design(case, index + 1, root_seed)[index]


def image(
    case: LookCase,
    trial: Trial,
    backdrop: Backdrop | None = None,
    moved: tuple[Layer, ...] | None = None,
) -> FloatArray:
    """Return the trial's region as the camera gives it, (rows, columns), 0..1.

    The zoom error scales about the optical axis; the truth stays the target's world
    pose, so an estimator that trusts the nominal zoom errs by ratio x distance. Trials
    that differ in the target's pose, light and noise alone may share their `backdrop`.
    By default `moved` are the target's layers in its place; none if they are in it.
    """
    return to_unit(counts(case, trial, backdrop, moved), case.sensor.bits)


def counts(
    case: LookCase,
    trial: Trial,
    backdrop: Backdrop | None = None,
    moved: tuple[Layer, ...] | None = None,
) -> CountArray:
    """Return the trial's region as the camera's counts; arguments as in `image`."""
    seen = _perturbed(case, trial)
    behind = still(case, trial) if backdrop is None else backdrop
    if moved is None:
        moved = moved_layers(case, trial.dx_um, trial.dy_um, trial.dtheta_rad)
    noiseless = picture(
        seen,
        moved,
        seen.microscope,
        focus_um=seen.focus_um,
        model=seen.model,
        light=seen.light,
        backdrop=behind.layers,
        under=behind.under,
    )
    rng = np.random.default_rng(np.random.SeedSequence(trial.seed))
    return expose(noiseless, seen.sensor, rng)


def still(case: LookCase, trial: Trial, reach: Range | None = None) -> Backdrop:
    """Return what stands still in a trial, blurred.

    Focus, zoom, law, lens and the occluder's place matter, the target's pose does not.
    Trials of one `reach` share the transforms; by default it is that of the design.
    """
    seen, reach = _perturbed(case, trial), reach or usual_range(case)
    focus_um, zoom, by_um = seen.focus_um, trial.magnification, trial.occluder_um
    if not seen.shares_still_layers or not reach.holds(focus_um, by_um, zoom):
        return fresh(seen, seen.static)
    found, left = Backdrop(), list(zip(case.static, seen.static, strict=True))
    for shift_um in dict.fromkeys((by_um, (0.0, 0.0))):  # the owner's stay
        group = [here for here, there in left if displaced(here, shift_um) == there]
        left = [pair for pair in left if pair[0] not in group]
        ready = standing(case, group, reach, trial.model) if group else None
        if ready is not None:
            own = ready.at(focus_um=focus_um, zoom=zoom, shift_um=shift_um)
            found = found.with_(own)
    return found.with_(fresh(seen, [there for _, there in left])) if left else found


def _owner(case: LookCase) -> str:
    return case.target.name.partition(".")[0]


def _perturbed(case: LookCase, trial: Trial) -> LookCase:
    """Return the look as it truly is in a trial, but for the target's pose."""
    return replace(
        case,
        static=shifted(
            case.static,
            _owner(case),
            trial.occluder_um,
            tuple(zip(case.spread.turning, trial.turns_rad, strict=True))
            if trial.turns_rad  # a trial made elsewhere turns nothing
            else (),
        ),
        microscope=_zoomed(case, trial),
        focus_um=case.focus_um + trial.dz_um,
        model=trial.model,
        light=Illumination(
            gain=case.light.gain * trial.gain,
            gradient_x=case.light.gradient_x + trial.gradient_x,
            gradient_y=case.light.gradient_y + trial.gradient_y,
        ),
        lens=case.lens if trial.lens is None else trial.lens,
        sensor=noisier(case.sensor, trial.noise),
    )


def _zoomed(case: LookCase, trial: Trial) -> Microscope:
    """Return the case's microscope at the trial's zoom."""
    magnification = case.microscope.magnification * trial.magnification
    return replace(case.microscope, magnification=magnification)


def _normal(points: FloatArray) -> FloatArray:
    """Return points of the unit cube in units of sigmas."""
    found: FloatArray = truncnorm.ppf(points, -CUT, CUT)
    return found


def _interior(
    case: LookCase,
    index: int,
    normal: FloatArray,
    point: FloatArray,
    rest: _Rest,
    root: int,
) -> Trial:
    """Return a point of the unit cube, five of it in sigmas, mapped to the spreads."""
    spread = case.spread
    theta = normal[2] * spread.pose_sigma_theta_rad
    if case.theta_any:
        theta = (2 * point[2] - 1) * math.pi
    low, high = spread.light_gain
    weak, strong = spread.light_gradient
    return _trial(
        case,
        index,
        root,
        place_um=tuple(normal[:2] * spread.pose_sigma_xy_um),
        theta_rad=theta,
        dz_um=normal[3] * spread.focus_sigma_um,
        magnification=1 + normal[4] * spread.magnification_sigma,
        gain=low + point[5] * (high - low),
        gradient=weak + point[6] * (strong - weak),
        direction_rad=2 * math.pi * point[7],
        rest=rest,
    )


def _extreme(case: LookCase, index: int, turn: int, root: int) -> Trial:
    """Return a corner of the spreads; directions are drawn, never on a pixel grid."""
    spread = case.spread
    sign = corner(turn)
    rng = generator(root, f"{case.key}/extreme {index}")
    radius = spread.search_um * rng.uniform(0.9, 1.0)
    toward = math.atan2(sign[1], sign[0]) + rng.uniform(-0.5, 0.5)
    theta = _CORNER * sign[2] * spread.pose_sigma_theta_rad
    if case.theta_any:
        theta = rng.uniform(-math.pi, math.pi)
    direction = rng.uniform(0, 2 * math.pi)
    far = _CORNER * rng.uniform(0.9, 1.0, 2)
    return _trial(
        case,
        index,
        root,
        place_um=(radius * math.cos(toward), radius * math.sin(toward)),
        theta_rad=theta,
        dz_um=_CORNER * sign[3] * spread.focus_sigma_um,
        magnification=1 + _CORNER * sign[4] * spread.magnification_sigma,
        gain=spread.light_gain[int(sign[5] > 0)],
        gradient=spread.light_gradient[int(sign[6] > 0)],
        direction_rad=direction,
        rest=_Rest(
            (far[0] * sign[7], far[1] * sign[8]),
            [_CORNER * s for s in sign[9:15]],
            float(sign[15] > 0),
        ),
    )


def _trial(
    case: LookCase,
    index: int,
    root: int,
    *,
    place_um: tuple[float, ...],
    theta_rad: float,
    dz_um: float,
    magnification: float,
    gain: float,
    gradient: float,
    direction_rad: float,
    rest: _Rest,
) -> Trial:
    """Return the trial with its blur law and noise seed."""
    sigma, (low, high) = case.spread.occluder_sigma_um, case.spread.noise
    # interior and extremes both meet both laws: the parity shifts by one every round
    other = (index + index // _EVERY) % 2 == 1
    return Trial(
        index=index,
        dx_um=float(place_um[0]),
        dy_um=float(place_um[1]),
        dtheta_rad=float(theta_rad),
        dz_um=float(dz_um),
        magnification=float(magnification),
        gain=float(gain),
        gradient_x=float(gradient * math.cos(direction_rad)),
        gradient_y=float(gradient * math.sin(direction_rad)),
        model=_OTHER_MODEL.get(case.model, "exact") if other else case.model,
        seed=(root, *words(f"{case.key}/trial {index}")),
        occluder_um=(sigma * float(rest.occluder[0]), sigma * float(rest.occluder[1])),
        lens=true_lens(case.lens, case.spread.lens, rest.lens),
        noise=low + rest.noise * (high - low),
        turns_rad=_turns(case, index, root),
    )


def _turns(case: LookCase, index: int, root: int) -> tuple[float, ...]:
    """Return by how much what lies at unknown angles is turned, rad."""
    if not case.spread.turning:
        return ()
    rng = generator(root, f"{case.key}/turning {index}")
    points = rng.random(len(case.spread.turning))
    return tuple(
        (2 * float(at) - 1) * math.pi
        if what.is_any
        else what.sigma_theta_rad * float(truncnorm.ppf(at, -CUT, CUT))
        for what, at in zip(case.spread.turning, points, strict=True)
    )
