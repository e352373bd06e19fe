"""The two-phase contract of an image routine, and the registry that finds one.

`prepare` runs in the compiler and gets the renderer as an argument; `measure` runs in
both the compiler and the executor, with numpy and cv2 only. Everything here is in
pixels of the *region*, the part of the frame cut out for the look: columns go right,
rows down, pixel centres are integers. Angles are counter-clockwise as displayed.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol, cast

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

TargetKind = Literal["circle", "teeth", "outline", "jaws"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What is to be found, in pixels of the region.

    `parameters` hold what the kind needs, lengths in um as named:
    circle `radius_um`; teeth `count`, `outer_um`, `root_um` (radii), `phase_rad` (angle
    of a tooth's middle at theta 0) and, where something breaks the symmetry,
    `notch_rad`, `notch_radius_um` (angle and radius of its middle at theta 0),
    `notch_width_um`, and `bore_um` (radius of the round hole it is cut into);
    outline `extent_um` (radius of the circle about the reference point that holds it);
    jaws `opening_um`, `finger_width_um`, `grip_from_tip_um` (fingers extend to +y).
    """

    name: str
    kind: TargetKind
    column: float  # nominal place of the reference point
    row: float
    theta_rad: float  # nominal angle
    px_per_um: float
    search_px: float  # the true place is within this of the nominal one
    theta_range_rad: float  # the true angle is within this of nominal; pi = any
    symmetry: int  # order of the rotational symmetry seen by coarse routines; 1 = none
    bright: bool  # whether the target is brighter than what surrounds it
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Artifact:
    """What `prepare` hands to `measure`: numbers for the plan, arrays for an npz."""

    parameters: Mapping[str, float]
    arrays: Mapping[str, npt.NDArray[np.float32]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Where to start: the nominal place, or what an earlier routine found."""

    column: float
    row: float
    theta_rad: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """Where the target is. `theta_rad` is None if the routine cannot tell."""

    column: float
    row: float
    theta_rad: float | None
    score: float  # 0..1, the routine's own confidence; gates compare it
    spread_px: float  # the routine's own estimate of its standard deviation per axis


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why a routine gives no answer: a stable code and a sentence with the numbers."""

    code: str  # e.g. "no_edge", "low_score", "outside", "ambiguous"
    message: str


class Render(Protocol):
    """Renders the look's region with the target displaced from its nominal pose."""

    def __call__(
        self, *, dx_um: float = 0.0, dy_um: float = 0.0, theta_rad: float = 0.0
    ) -> FloatArray:
        """Return the (rows, columns) noise-free image, 0..1 of full scale."""
        ...


class Routine(Protocol):
    """One image routine; modules in this package are such objects."""

    NAME: str
    VERSION: str
    KINDS: tuple[TargetKind, ...]  # target kinds it can look for
    GIVES: tuple[str, ...]  # of "xy", "theta"
    NEEDS: tuple[str, ...]  # of "seed" (a guess better than nominal), ()
    COST: float  # relative cost of one `measure`, in 640 x 480 box filters

    def prepare(self, render: Render, target: Target) -> Artifact | Failure:
        """Return what `measure` needs, computed from the nominal image."""
        ...

    def measure(
        self, image: FloatArray, artifact: Artifact, guess: Guess
    ) -> Measurement | Failure:
        """Return where the target is in `image`, (rows, columns) 0..1, or why not."""
        ...


# id -> module; loaded on first use so that the executor's start stays cheap
REGISTRY: Mapping[str, str] = {
    "circle_caliper": "featuresel.routines.circle_caliper",
    "edge_caliper": "featuresel.routines.edge_caliper",
    "ncc": "featuresel.routines.ncc",
    "otsu": "featuresel.routines.otsu",
    "tooth_notch": "featuresel.routines.tooth_notch",
}


def load(name: str) -> Routine:
    """Return the routine called `name`; KeyError if there is none."""
    return cast(Routine, importlib.import_module(REGISTRY[name]))
