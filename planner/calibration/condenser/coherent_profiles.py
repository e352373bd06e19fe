"""Profiles across a part's edges in the compiler's images, by the light's coherence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase, moved_layers
from microplan.optics.coherence.coherence import render_coherent
from microplan.optics.outline.offset import offset
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.zernike import turns_of
from microplan.planner.calibration.condenser.edge_mean import edge_mean
from microplan.planner.calibration.through_focus.edge_profile import (
    EdgePoints,
    across_px,
)

MOST = 2.0  # condenser over objective: beyond profiles hardly change, and images cost
WAVES = 0.25  # of defocus at the rim by which profiles are told to be out of focus
LEAST = 0.08  # the same: below light is as good as coherent
_NODES = (LEAST, 0.13, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 1.0, 1.15, 1.5, 2.0)
_FEW = 3  # nodes up to 1 at which a defocus and an offset are told
_SAMPLES = 10  # of the source: mean profiles change by 3e-4 of a step to 16
_ROUGHLY = 6  # of the source out of focus: what changes with it is small
_GROWN = 0.05  # wavelength / A by which edges are moved outwards, to see what changes


@dataclass(frozen=True, slots=True, kw_only=True)
class CoherentProfiles:
    """Profiles of a white part on black, and of a black one on white; by coherence.

    With amplitudes a of the part and b around it light is a^2 own + b^2 around + a b
    (1 - own - around): a field without edges is as bright everywhere. Images have the
    wavefront error and the halo that the workcell states.
    """

    nodes: FloatArray  # (S,) coherence, rising
    pieces: tuple[CubicSpline | PchipInterpolator, ...]  # (2, L), below 1 and above
    blurred: PchipInterpolator  # (2, L) by which defocus of `WAVES` changes them
    grown: PchipInterpolator  # (2, L) a px by which an offset does more than move them

    @classmethod
    def of(
        cls,
        nodes: FloatArray,
        sharp: FloatArray,
        some: FloatArray,
        changes: tuple[FloatArray, FloatArray],
    ) -> Self:
        """Return the table through profiles (S, 2, L) at nodes (S,), rising.

        `changes` are `blurred` and `grown` at nodes `some` (B,), (B, 2, L) each. Where
        the direct light ends, at 1, profiles have a bend.
        """
        low, high = nodes <= 1, nodes >= 1
        pieces = [_piece(nodes[k], sharp[k]) for k in (low, high) if k.sum() > 1]
        blurred, grown = (PchipInterpolator(some, each, axis=0) for each in changes)
        return cls(nodes=nodes, pieces=tuple(pieces), blurred=blurred, grown=grown)

    @property
    def least(self) -> float:
        """Return the smallest coherence."""
        return float(self.nodes[0])

    @property
    def most(self) -> float:
        """Return the largest coherence."""
        return float(self.nodes[-1])

    def __call__(
        self, coherence: float, ratio: float, defocus: float, offset_px: float
    ) -> FloatArray:
        """Return the light across edges of a part of amplitude 1, (L,).

        Parameters
        ----------
        coherence : float
            Condenser over objective aperture; held at the ends.
        ratio : float
            Amplitude around the part.
        defocus : float
            The square of the defocus over `WAVES`.
        offset_px : float
            Of the part's own edges, outwards.
        """
        s = min(max(coherence, self.least), self.most)
        piece = self.pieces[0 if s <= 1 else -1]
        known = min(max(s, float(self.blurred.x[0])), float(self.blurred.x[-1]))
        seen = moved_out(piece(s) + defocus * self.blurred(known), offset_px)
        own, around = seen + offset_px * self.grown(known)
        found: FloatArray = own + ratio**2 * around + ratio * (1 - own - around)
        return found


def moved_out(profiles: FloatArray, offset_px: float) -> FloatArray:
    """Return profiles (..., L) moved outwards."""
    turned: FloatArray = profiles @ _moves()(across_px() - offset_px).T
    return turned


@lru_cache(maxsize=1)
def _moves() -> CubicSpline:
    """Return the spline through each single value of a profile, (L,) at a place."""
    across = across_px()
    return CubicSpline(across, np.eye(len(across)))


def _piece(nodes: FloatArray, values: FloatArray) -> CubicSpline | PchipInterpolator:
    make = CubicSpline if len(nodes) > 3 else PchipInterpolator
    return make(nodes, values, axis=0)


def coherent_profiles(
    points: EdgePoints, pose: tuple[float, float, float], within: tuple[float, float]
) -> CoherentProfiles | None:
    """Return the profiles of a part's edges; None if images do not show them.

    Parameters
    ----------
    points : EdgePoints
        Of the look, a part of one height.
    pose : (x, y, theta)
        Of the target, um and rad from nominal.
    within : (least, most)
        Coherence that settings may have.
    """
    nodes, scope = nodes_about(*within), points.case.microscope
    sharp = _rows(points, pose, nodes)
    if sharp is None:
        return None
    below = max(sum(node <= 1 for node in nodes) - 1, 1)
    at = np.unique(np.linspace(0, below, _FEW).round().astype(int)).tolist()
    some = [nodes[k] for k in at]
    z_um = WAVES * scope.wavelength_um / abs(scope.rim_w20_um(1.0))
    grow_um = _GROWN * scope.wavelength_um / scope.aperture
    blurred = _blurred(points, pose, some, z_um)
    grown = _rows(points, pose, some, grow_um=grow_um)
    if blurred is None or grown is None:
        return None
    grow_px = grow_um / scope.um_per_px
    more = (grown - moved_out(sharp[at], grow_px)) / grow_px
    changes = blurred - sharp[at], more
    return CoherentProfiles.of(np.array(nodes), sharp, np.array(some), changes)


def tells_sides(microscope: Microscope) -> bool:
    """Return whether edges above the plane in focus look otherwise than below it."""
    return any(turns_of(noll) % 2 == 0 for noll, waves in microscope.wavefront if waves)


def _blurred(
    points: EdgePoints,
    pose: tuple[float, float, float],
    nodes: Sequence[float],
    z_um: float,
) -> FloatArray | None:
    """Return profiles (S, 2, L) out of focus, the mean of both sides of it."""
    above = _rows(points, pose, nodes, z_um=z_um)
    if above is None or not tells_sides(points.case.microscope):
        return above
    below = _rows(points, pose, nodes, z_um=-z_um)
    return None if below is None else (above + below) / 2


def nodes_about(least: float, most: float) -> list[float]:
    """Return the coherences of a table from one to another, one beyond either."""
    low = max(sum(node < least for node in _NODES) - 1, 0)
    high = sum(node <= most for node in _NODES) + 1
    return list(_NODES[low:high])


def _rows(
    points: EdgePoints,
    pose: tuple[float, float, float],
    nodes: Sequence[float],
    *,
    z_um: float = 0.0,
    grow_um: float = 0.0,
) -> FloatArray | None:
    """Return profiles (S, 2, L) of images out of focus, or of a part that is larger."""
    found = []
    for node in nodes:
        for faces in ((1.0, 0.0), (0.0, 1.0)):
            layers = _flat(points.case, pose, faces[0], grow_um)
            scene = Scene(layers=layers, background=faces[1])
            found.append(_profile(points, pose, scene, node, z_um))
    kept = [each for each in found if each is not None]
    if len(kept) < len(found):
        return None
    return np.array(kept).reshape(len(nodes), 2, -1)


def _profile(
    points: EdgePoints,
    pose: tuple[float, float, float],
    scene: Scene,
    coherence: float,
    z_um: float,
) -> FloatArray | None:
    """Return the profile in one image, (L,), in focus at a height."""
    case, (x_um, y_um, turn) = points.case, pose
    image = render_coherent(
        scene,
        case.microscope,
        focus_um=z_um,
        coherence=coherence,
        window=case.window,
        samples=_ROUGHLY if z_um else _SAMPLES,
    )
    at_px = case.frame.to_pixel(case.x_um + x_um, case.y_um + y_um)
    theta = case.target.theta_rad + turn
    return edge_mean(replace(points, theta_rad=theta), image, at_px)


def _flat(
    case: LookCase,
    pose: tuple[float, float, float],
    reflectance: float,
    grow_um: float,
) -> tuple[Layer, ...]:
    """Return the part as faces in the plane in focus."""
    return tuple(
        Layer(
            name=each.name,
            outline=offset(each.outline, grow_um),
            z_um=0.0,
            reflectance=reflectance,
        )
        for each in moved_layers(case, *pose)
    )
