"""Radiance of faces under coaxial light that other bodies shade."""

from __future__ import annotations

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

MOST_RAYS = 1 << 20  # at once
FINER = 4  # points between two of a shading's lattice: read along straight lines


class FaceLight:
    """What faces give back to rays of the camera; remembers how they are lit."""

    def __init__(
        self,
        solids: Solids,
        stage_reflectance: float,
        view: ImagingView,
        sampling: RaySampling,
        box: Box,  # that no ray leaves, from the image's middle
    ) -> None:
        self._solids, self._view, self._sampling = solids, view, sampling
        self.stage_reflectance = stage_reflectance
        self._box = box
        self._maps: dict[float, _ShadeMap] = {}  # by height

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
        if all(body.top_um <= at_um for body in self._solids.bodies):
            return np.ones(len(rays))
        if at_um not in self._maps:
            self._maps[at_um] = _ShadeMap(
                self._solids, self._view, self._sampling, at_um, self._box
            )
        return self._maps[at_um].at(rays.x, rays.y)

    def _mirrored(self, rays: RayFan, at_um: float) -> FloatArray:
        """Return the light that comes along the rays that a mirror sends up."""
        view = self._view
        speed = np.hypot(rays.slope_x, rays.slope_y)
        lamp = within_lamp(view, speed)
        norm = min(view.lamp_share, 1.0) ** 2  # a mirror alone is as bright as a face
        up = RayFan(
            rays.x, rays.y, rays.slope_x, rays.slope_y,
            np.ones(len(rays), dtype=np.float32),
            np.arange(len(rays), dtype=np.int32), rays.bounced,
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
    ) -> None:
        self._solids, self._at_um = solids, at_um
        self._slopes = pupil_slopes(
            view, sampling.lamp_rays, turn_rad=sampling.turn_rad, share=view.lamp_share
        )
        self._spread = beam_spread(view, sampling.lamp_rays, share=view.lamp_share)
        above = min(b.top_um - at_um for b in solids.bodies if b.top_um > at_um)
        blur_um = view.steepest * view.lamp_share * above
        spacing = float(
            np.clip(
                sampling.spacing * blur_um,
                sampling.least_spacing_um,
                sampling.most_spacing_um,
            )
        )
        self._lattice: PointLattice = lattice_over(box, spacing)
        self._fine = self._lattice.finer(FINER)
        self._smooth = np.zeros((len(self._fine.y_um), len(self._fine.x_um)))
        shape = (len(self._lattice.y_um), len(self._lattice.x_um))
        self._values, self._asked = np.zeros(shape), np.zeros(shape, dtype=bool)
        self._good = np.zeros(shape, dtype=bool)

    def at(self, x: Reals32, y: Reals32) -> FloatArray:
        """Return shares at points, (N,)."""
        used = self._lattice.used(x, y)
        # the cubic reads one point more to each side than a cell's corners
        new = widened(used) & ~self._asked
        if new.any():
            self._compute(new)
            self._asked |= new
            values = filled(self._values, self._good)
            self._smooth = self._lattice.smooth(
                values, self._fine.x_um, self._fine.y_um
            )
        return self._fine.at(self._smooth, x, y)

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
        np.zeros(total, dtype=bool),
    )
