"""Calibration of a station: image scale, shift, handedness, stable servo gains."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import Point
from microplan.executor.devices.errors import ExecutorError
from microplan.featuresel.routines.picture import RegionFrame
from microplan.schemas.plan import Look, Measure, Plan, Region, Requirements
from microplan.schemas.pose import Pose


def stable_gain(latency_frames: int, turn_rad: float = 0.0) -> float:
    """Return the gain below which a servo that sees old frames settles.

    Parameters
    ----------
    latency_frames : int
        Looks by which a picture is older than it seems, d >= 0.
    turn_rad : float
        Rotation of the image against the stage, phi; at pi / 2 nothing settles.

    Returns
    -------
    float
        2 sin((pi / 2 - |phi|) / (2 d + 1)), 0 where nothing is stable.

    Notes
    -----
    e[k+1] = e[k] - g R(phi) e[k-d] has the roots of z^(d+1) - z^d + g e^(i phi). One
    leaves the unit circle at z = e^(i w) with |z - 1| = 2 sin(w / 2) = g and
    (2 d + 1) w / 2 = pi / 2 - |phi|.
    """
    if latency_frames < 0:
        raise ValueError(f"frames are {latency_frames} looks old, must be 0 or more")
    left_rad = max(math.pi / 2 - abs(turn_rad), 0.0)
    return 2 * math.sin(left_rad / (2 * latency_frames + 1))


def check_gains(
    plan: Plan, latency_frames: int, calibration: Calibration | None
) -> None:
    """Raise MP837 if an alignment's gain is not stable on the station.

    The image's scale counts into the gain, its rotation into the limit.
    """
    (a, b), (c, d) = IDENTITY if calibration is None else calibration.camera_from_stage
    turn_rad = math.atan2(c - b, a + d)
    scale = math.hypot(a + d, c - b) / 2
    limit = stable_gain(latency_frames, turn_rad)
    for step in plan.steps:
        control = step.control
        if control is None or control.method != "servo":
            continue
        if not 0 < control.gain * scale < limit:
            raise ExecutorError(
                "MP837",
                f"step {step.id} corrects with gain {control.gain:g} on an image "
                f"scaled by {scale:.4g}; between 0 and {limit:.4g} is stable with "
                f"frames {latency_frames} looks old",
            )


Matrix = tuple[tuple[float, float], tuple[float, float]]

# A calibrated zoom counts as a plan's if they agree to what an encoder can repeat.
SAME_ZOOM = 1e-3
IDENTITY: Matrix = ((1.0, 0.0), (0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomPoint:
    """Calibration at one zoom."""

    magnification: float
    um_per_px: float
    shift_um: Point = (0.0, 0.0)  # of the whole image: what is at 0 is shown there


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Scale and image shift by zoom, and how the image follows the stage.

    `camera_from_stage` takes a move of the stage's readings to the move of the image in
    the world frame, um to um. It is the identity in a cell as plans assume it, and has
    a negative determinant if the image is mirrored.
    """

    zooms: tuple[ZoomPoint, ...]  # by rising magnification, at least one
    camera_from_stage: Matrix = IDENTITY

    def at(self, magnification: float) -> ZoomPoint | None:
        """Return the calibration of a zoom; None beyond the outermost points.

        Between points, um per px times magnification and the shift are linear in the
        logarithm of the magnification.
        """
        zooms = self.zooms
        low, high = zooms[0].magnification, zooms[-1].magnification
        if not low * (1 - SAME_ZOOM) <= magnification <= high * (1 + SAME_ZOOM):
            return None
        after = bisect.bisect_left([z.magnification for z in zooms], magnification)
        right = zooms[min(max(after, 1), len(zooms) - 1)]
        left = zooms[max(min(after, len(zooms) - 1) - 1, 0)]
        if left is right:
            share = 0.0
        else:
            ratio = right.magnification / left.magnification
            share = math.log(magnification / left.magnification) / math.log(ratio)
        pitch = _between(_pitch_um(left), _pitch_um(right), share)
        return ZoomPoint(
            magnification=magnification,
            um_per_px=pitch / magnification,
            shift_um=(
                _between(left.shift_um[0], right.shift_um[0], share),
                _between(left.shift_um[1], right.shift_um[1], share),
            ),
        )

    @property
    def mirrored(self) -> bool:
        """Return whether the image is mirrored to the stage."""
        (a, b), (c, d) = self.camera_from_stage
        return a * d - b * c < 0


@dataclass(frozen=True, slots=True, kw_only=True)
class LookFrame:
    """Pixels of a look's region to um of the world and back, the image shift undone."""

    region: RegionFrame
    shift_um: Point

    def to_world(self, column: float, row: float) -> Point:
        """Return (x, y) um of a pixel of the region."""
        x_um, y_um = self.region.to_world(column, row)
        return (x_um - self.shift_um[0], y_um - self.shift_um[1])

    def to_pixel(self, x_um: float, y_um: float) -> Point:
        """Return (column, row) of the region for a world point."""
        return self.region.to_pixel(x_um + self.shift_um[0], y_um + self.shift_um[1])


def look_frame(
    look: Look, need: Requirements, calibration: Calibration | None
) -> LookFrame:
    """Return the map between a look's region and the world.

    By the station's calibration where it has one, else by the plan's own scale.
    """
    found = None if calibration is None else calibration.at(look.view.magnification)
    region = look.measure.region
    return LookFrame(
        region=RegionFrame(
            width_px=need.width_px,
            height_px=need.height_px,
            um_per_px=look.view.um_per_px if found is None else found.um_per_px,
            row=region.row,
            column=region.column,
        ),
        shift_um=(0.0, 0.0) if found is None else found.shift_um,
    )


def planned_pose(measure: Measure) -> Pose:
    """Return the planned pose of a look's target, by one of its features'."""
    pose = measure.reference.pose
    turned = replace(pose, theta_rad=pose.theta_rad - measure.turn_rad)
    x_um, y_um = turned.apply(-measure.offset_um[0], -measure.offset_um[1])
    return replace(turned, x_um=x_um, y_um=y_um)


def placed_look(
    look: Look, need: Requirements, planned: LookFrame, expected: Pose
) -> Look:
    """Return a look with its region about its target as it is believed.

    As many whole pixels off the planned one as the target is believed off its planned
    place, if what is about it lies off as well (`View.follows`); within the frame. It
    stays there from then on.

    Parameters
    ----------
    look : Look
        Which look.
    need : Requirements
        The plan's, with the size of the frame.
    planned : LookFrame
        Of the planned region.
    expected : Pose
        Believed pose of the look's target, world.
    """
    if not look.view.follows:
        return look
    region, at = look.measure.region, planned_pose(look.measure)
    before, now = (planned.to_pixel(p.x_um, p.y_um) for p in (at, expected))
    right, down = (round(b - a) for a, b in zip(before, now, strict=True))
    column = min(max(region.column + right, 0), need.width_px - region.columns)
    row = min(max(region.row + down, 0), need.height_px - region.rows)
    return in_region(look, replace(region, column=column, row=row), planned)


def in_region(look: Look, region: Region, planned: LookFrame) -> Look:
    """Return a look that reads another region, and does not follow from there.

    Its target is in the same pixels of it as in the planned one.
    """
    first, *others = (_moved(each, region, planned) for each in look.measures)
    return replace(
        look,
        view=replace(look.view, follows=False),
        measure=first,
        others=tuple(others),
    )


def _moved(measure: Measure, region: Region, planned: LookFrame) -> Measure:
    """Return a measurement in another region, where the same pixels are of it."""
    right = region.column - measure.region.column
    down = region.row - measure.region.row
    x_um, y_um = np.subtract(planned.to_world(right, down), planned.to_world(0, 0))
    pose = measure.reference.pose
    pose = replace(pose, x_um=pose.x_um + float(x_um), y_um=pose.y_um + float(y_um))
    return replace(
        measure, region=region, reference=replace(measure.reference, pose=pose)
    )


def _pitch_um(point: ZoomPoint) -> float:
    """Return the pixel pitch on the sensor at a calibrated zoom, um."""
    return point.um_per_px * point.magnification


def _between(low: float, high: float, share: float) -> float:
    """Return the linear interpolation from low to high at `share`."""
    return low + share * (high - low)
