"""Radiance of faces under coaxial light that other bodies shade."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microplan.arrays import BoolArray, Box, FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView, RaySampling
from microplan.executor.simulated.imaging.rays.beams import beams_from, pass_up
from microplan.executor.simulated.imaging.rays.lattice import (
    PointLattice,
    filled,
    lattice_over,
    widened,
)
from microplan.executor.simulated.imaging.rays.marching import (
    STAGE,
    FaceHits,
    RayFan,
    Reals32,
    Solids,
)
from microplan.executor.simulated.imaging.rays.pupil_rays import (
    beam_spread,
    pupil_slopes,
    within_lamp,
)
from microplan.executor.simulated.imaging.rays.regions import moved_outside

FAR_UM = 60.0  # a plane farther out of focus is left to rays alone
MOST_RAYS = 1 << 18  # at once
FINER = 4  # points between two of a shading's lattice: read along straight lines
FEW = 4  # points of a shading seen at once: fewer are as good as one
LEAST_SHARE = 0.5  # of the lamp's rays: fewer, wider beams are biased


class FaceLight:
    """What faces give back to rays of the camera; remembers how they are lit."""

    def __init__(
        self,
        solids: Solids,
        stage_reflectance: float,
        view: ImagingView,
        sampling: RaySampling,
        box: Box,  # that no ray leaves, from the image's middle
        sharp_um: float | None,  # height of the plane that is seen; None: far from all
    ) -> None:
        self._solids, self._view, self._sampling = solids, view, sampling
        self.stage_reflectance = stage_reflectance
        self._box, self._sharp_um = box, sharp_um
        self._maps: dict[float, _ShadeMap] = {}  # by height

    def prepare(self, hits: Sequence[FaceHits]) -> None:
        """Compute how faces are lit where rays end on them."""
        if self._view.lamp_share == 0:
            return
        ends: dict[float, list[RayFan]] = {}
        for hit in hits:
            finish, at_um = 0.0, self._solids.stage_um
            if hit.face != STAGE:
                face = self._solids.bodies[hit.face]
                finish, at_um = face.body.finish, face.top_um
            if finish < 1 and len(hit.rays) and not self._open(at_um):
                ends.setdefault(at_um, []).append(hit.rays)
        for at_um, fans in ends.items():
            self._map(at_um).ask(fans)

    def radiance(self, hits: FaceHits) -> FloatArray:
        """Return what each ray brings back, (N,) shares of full scale."""
        rays, reflectance, finish = hits.rays, self.stage_reflectance, 0.0
        at_um = self._solids.stage_um
        if hits.face != STAGE:
            face = self._solids.bodies[hits.face]
            reflectance, finish = face.body.reflectance, face.body.finish
            at_um = face.top_um
        if self._view.lamp_share == 0:
            lit = np.ones(len(rays))
        else:
            lit = np.zeros(len(rays))
            if finish < 1:
                lit += (1 - finish) * self._irradiance(rays, at_um)
            if finish > 0:
                lit += finish * self._mirrored(rays, at_um)
        total: FloatArray = reflectance * lit * rays.weight
        return total

    def _irradiance(self, rays: RayFan, at_um: float) -> FloatArray:
        """Return the share of the lamp's cone that reaches where rays end."""
        if self._open(at_um):
            return np.ones(len(rays))
        return self._map(at_um).at(rays.x, rays.y)

    def _open(self, at_um: float) -> bool:
        """Return whether nothing is above a height."""
        return all(body.top_um <= at_um for body in self._solids.bodies)

    def _map(self, at_um: float) -> _ShadeMap:
        """Return the shading at a height, with as many rays as its use asks for."""
        if at_um not in self._maps:
            away_um = FAR_UM if self._sharp_um is None else abs(at_um - self._sharp_um)
            self._maps[at_um] = _ShadeMap(
                self._solids, self._view, self._sampling, at_um, self._box, away_um
            )
        return self._maps[at_um]

    def _mirrored(self, rays: RayFan, at_um: float) -> FloatArray:
        """Return the light that comes along the rays that a mirror sends up."""
        view = self._view
        speed = np.hypot(rays.slope_x, rays.slope_y)
        lamp = within_lamp(view, speed)
        norm = min(view.lamp_share, 1.0) ** 2  # a mirror alone is as bright as a face
        up = RayFan(
            rays.x, rays.y, rays.slope_x, rays.slope_y,
            np.ones(len(rays), dtype=np.float32),
            np.arange(len(rays), dtype=np.int32),
        )  # fmt: skip
        sky = self._solids.ascend(up, at_um)
        reached = np.bincount(sky.owner, weights=sky.weight, minlength=len(rays))
        light: FloatArray = reached * lamp / norm
        return light


class _ShadeMap:
    """Share of the lamp's cone that reaches points at one height, where asked for."""

    def __init__(
        self,
        solids: Solids,
        view: ImagingView,
        sampling: RaySampling,
        at_um: float,
        box: Box,
        away_um: float,  # from the plane that is seen
    ) -> None:
        self._solids, self._at_um = solids, at_um
        above = min(b.top_um - at_um for b in solids.bodies if b.top_um > at_um)
        blur_um = view.steepest * view.lamp_share * above
        spacing = float(
            np.clip(
                sampling.spacing * blur_um,
                sampling.least_spacing_um,
                sampling.most_spacing_um,
            )
        )
        # the errors of rays, N**-.75 at each point, even out over those seen at once
        seen = math.pi * (view.steepest * away_um / spacing) ** 2
        share = (FEW / max(seen, FEW)) ** (2 / 3)
        count = round(sampling.lamp_rays * max(share, LEAST_SHARE))
        self._slopes = pupil_slopes(
            view, count, turn_rad=sampling.turn_rad, share=view.lamp_share
        )
        self._spread = beam_spread(view, count, share=view.lamp_share)
        self._lattice: PointLattice = lattice_over(box, spacing)
        self._fine = self._lattice.finer(FINER)
        self._smooth = np.zeros(
            (len(self._fine.y_um), len(self._fine.x_um)), dtype=np.float32
        )
        shape = (len(self._lattice.y_um), len(self._lattice.x_um))
        self._values, self._asked = np.zeros(shape), np.zeros(shape, dtype=bool)
        self._good = np.zeros(shape, dtype=bool)
        self._drawn = np.zeros(shape, dtype=bool)

    def ask(self, fans: Sequence[RayFan]) -> None:
        """Compute what is needed at the ends of rays."""
        used = np.zeros_like(self._asked)
        for rays in fans:
            used |= self._lattice.used(rays.x, rays.y)
        fresh = used & ~self._drawn
        if not fresh.any():
            return
        # the cubic reads one point more to each side than a cell's corners
        new = widened(used) & ~self._asked
        if new.any():
            self._compute(new)
            self._asked |= new
        self._drawn |= fresh
        values = filled(self._values, self._good)
        ends = [(int(at.min()), int(at.max())) for at in np.nonzero(fresh)]
        rows, columns = (slice(max(a - 2, 0), b + 3) for a, b in ends)
        down, across = (slice(FINER * a, FINER * b + 1) for a, b in ends)
        part = PointLattice(
            x_um=self._lattice.x_um[columns],
            y_um=self._lattice.y_um[rows],
            spacing_um=self._lattice.spacing_um,
        )
        self._smooth[down, across] = part.smooth(
            values[rows, columns], self._fine.x_um[across], self._fine.y_um[down]
        )

    def at(self, x: Reals32, y: Reals32) -> Reals32:
        """Return shares at points that were asked for, (N,)."""
        return self._fine.quick_at(self._smooth, x, y)

    def _compute(self, new: BoolArray) -> None:
        """Compute the points of a (rows, columns) mask."""
        rows, columns = np.nonzero(new)
        x, y, good = moved_outside(
            self._lattice.x_um[columns],
            self._lattice.y_um[rows],
            self._solids.crossing(self._at_um),
        )
        many = max(1, MOST_RAYS // len(self._slopes))
        shares = [
            self._shares(x[i : i + many], y[i : i + many])
            for i in range(0, len(x), many)
        ]
        self._values[rows, columns] = np.concatenate(shares)
        self._good[rows, columns] = good

    def _shares(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the lamp's share that reaches points, (N,)."""
        start = beams_from(fan_through(x, y, self._slopes), 0.0, self._spread)
        beams, bent = pass_up(self._solids, start, self._at_um, self._spread)
        count, total = len(self._slopes), np.zeros(len(x))
        for sky in (beams.rays, bent):
            owner = sky.owner // count
            total += np.bincount(owner, weights=sky.weight, minlength=len(x))
        share: FloatArray = total / count
        return share


def fan_through(x: FloatArray, y: FloatArray, slopes: FloatArray) -> RayFan:
    """Return rays of all slopes, (count, 2), through each point, (N,) um.

    Ray i * count + k goes through point i along slope k, and is its own owner.
    """
    many, count = len(x), len(slopes)
    total = many * count
    return RayFan(
        np.repeat(x.astype(np.float32), count),
        np.repeat(y.astype(np.float32), count),
        np.tile(slopes[:, 0].astype(np.float32), many),
        np.tile(slopes[:, 1].astype(np.float32), many),
        np.ones(total, dtype=np.float32),
        np.arange(total, dtype=np.int32),
    )
