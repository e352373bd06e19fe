"""What a target and its occluder hide together, out of focus: read at any pose.

Rays that pass the occluder meet other parts of the target's edge than those that do
not. What the product of both leaves out lies about that edge and moves with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.featuresel.routines.contract import Artifact, Target
from microplan.featuresel.routines.likelihood.appearance import (
    Appearance,
    ImagePose,
    TargetLight,
)
from microplan.featuresel.routines.likelihood.front_maps import FrontMaps
from microplan.featuresel.routines.likelihood.spline import (
    plane_coefficients,
    runout_coefficients,
)

_LEAST = 5e-4  # of full scale: a tenth of the noise of usual cameras
_SUPPORT = 3  # pixels around one that a cubic spline needs
_NEAR = 0.1  # depths beside focus: there the slope by its square is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class JointBlur:
    """The joint part of target and occluder, by the target's place."""

    still: Appearance  # at the nominal place
    # by moves to the right and down, per px, their squares and product, per px^2
    by_place: tuple[Appearance, ...]
    place_px: tuple[float, float]  # column and row that is nominal
    far_px: float  # beyond such a move the change is that of it
    depth_um: float  # planes are at equal steps of the asinh of heights over this

    def light(
        self, pose: ImagePose, columns: IntArray, rows: IntArray, *, squared: bool
    ) -> TargetLight:
        """Return the joint part at pixels (N,), full scale 1, and its slopes.

        Where the fit is `squared` the occluder has the sign of the focus.
        """
        here, z = self._focused(pose, squared=squared)
        found = self.still.light(here, columns, rows)
        more = [each.light(here, columns, rows).value for each in self.by_place]
        x, y = np.clip(
            np.subtract((pose.column, pose.row), self.place_px),
            -self.far_px,
            self.far_px,
        )
        by_um = 1 / (math.hypot(z, 1.0) * self.depth_um)
        if squared:
            by_um *= math.copysign(1 / (2 * self.depth_um * max(abs(z), _NEAR)), z)
        return replace(
            found,
            value=found.value
            + x * (more[0] + x * more[2])
            + y * (more[1] + y * more[3] + x * more[4]),
            across=found.across + more[0] + 2 * x * more[2] + y * more[4],
            down=found.down + more[1] + 2 * y * more[3] + x * more[4],
            focus=by_um * found.focus,
        )

    def values(
        self,
        pose: ImagePose,
        turns: FloatArray,
        columns: IntArray,
        rows: IntArray,
        *,
        squared: bool,
    ) -> FloatArray:
        """Return the nominal place's at (T, N) pixels, (T,) rotations in rad, 0..1."""
        here, _ = self._focused(pose, squared=squared)
        return self.still.values(here, turns, columns, rows)

    def _focused(self, pose: ImagePose, *, squared: bool) -> tuple[ImagePose, float]:
        """Return the pose in the planes' steps of focus, and its height in depths."""
        z = pose.z_um / self.depth_um
        if squared:
            z = math.copysign(z, pose.occluder_blur.focus_um)
        return replace(pose, z_um=math.asinh(z)), z


def joint_artifact(maps: FrontMaps, target: Target) -> Artifact | None:
    """Return the joint part for `read_joint`, None where there is none."""
    far_px = max(1.0, target.search_px)
    scale = far_px ** np.array([0, 1, 1, 2, 2, 2])[:, None, None]
    shows: BoolArray = np.abs(maps.joint * scale).max(axis=(0, 1)) > _LEAST
    if not shows.any():
        return None
    side = 2 * _SUPPORT + 1
    kept = cv2.dilate(shows.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    fine = kept.repeat(2, axis=0).repeat(2, axis=1)
    first, step = float(maps.joint_steps[0]), float(np.diff(maps.joint_steps)[0])
    return Artifact(
        parameters={
            "joint_first": first - step,
            "joint_step": step,
            "joint_depth_um": maps.depth_um,
            "joint_column": target.column,
            "joint_row": target.row,
            "joint_far_px": far_px,
        },
        arrays={
            "front_joint": _packed(maps.joint_fine[:, None], fine, 2),
            "front_joint_cells": _numbered(fine),
            "front_joint_moved": _packed(maps.joint[:, 1:], kept, 1),
            "front_joint_moved_cells": _numbered(kept),
        },
    )


def _numbered(kept: BoolArray) -> Float32Array:
    """Return the cells' numbers, (rows, columns), from 1; 0 for those left out."""
    return np.where(kept, np.cumsum(kept).reshape(kept.shape), 0).astype(np.float32)


def _packed(maps: FloatArray, kept: BoolArray, over: int) -> Float32Array:
    """Return coefficients, (K + 2, M, cells), of maps (K, M, rows, columns)."""
    planes = [
        [plane_coefficients(m, over=over, side=0.0, turns=False)[0] for m in height]
        for height in maps
    ]
    deep = runout_coefficients(np.array(planes))
    packed = np.zeros((*deep.shape[:2], int(kept.sum()) + 1), np.float32)
    packed[:, :, 1:] = deep[:, :, kept]
    return packed


def read_joint(artifact: Artifact) -> JointBlur | None:
    """Return what `joint_artifact` made, None if it made nothing."""
    if "front_joint" not in artifact.arrays:
        return None
    p: Mapping[str, float] = artifact.parameters
    arrays = artifact.arrays
    fine, where = arrays["front_joint"], arrays["front_joint_cells"]
    moved, rough = arrays["front_joint_moved"], arrays["front_joint_moved_cells"]
    return JointBlur(
        still=_plane(fine[:, 0], where, p, over=2),
        by_place=tuple(
            _plane(moved[:, k], rough, p, over=1) for k in range(moved.shape[1])
        ),
        place_px=(p["joint_column"], p["joint_row"]),
        far_px=p["joint_far_px"],
        depth_um=p["joint_depth_um"],
    )


def _plane(
    packed: Float32Array, where: Float32Array, p: Mapping[str, float], *, over: int
) -> Appearance:
    """Return one of the maps, (heights, cells), at any pose of the target."""
    none: FloatArray = np.zeros(where.shape)
    return Appearance(
        planes=packed[:, None],
        cells=where.ravel(),
        uses=none.astype(np.float32),
        shape=(where.shape[0], where.shape[1]),
        over=over,
        middle=(over * p["joint_column"], over * p["joint_row"]),
        first_um=p["joint_first"],
        step_um=p["joint_step"],
        is_even=False,
        heights=2,
    )
