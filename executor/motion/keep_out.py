"""Keep-out check: collisions of a move with parts or fingers, by their beliefs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import check_finite, targets
from microplan.executor.motion.beliefs import Beliefs, Readings
from microplan.executor.motion.swept_volume import (
    ROUNDING_UM,
    SweptVolume,
    Travel,
    first_meeting,
    hull,
)
from microplan.schemas.codec import to_data
from microplan.schemas.plan import AxesName, AxisMove, GraspAction, InsertAction, Plan
from microplan.schemas.plan.views import MOST_CORNERS, Prism

Pair = frozenset[str]

SURFACE = "the stage"


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Beliefs, readings and jaw openings before a motion."""

    beliefs: Beliefs
    readings: Readings
    openings_um: tuple[float, ...]  # of the jaws, all that the motion goes through


class KeepOut:
    """Refuses motions whose swept volume meets anything that is not to be touched.

    A plan without the volumes of its parts lets everything pass.

    Parameters
    ----------
    plan : Plan
        Gives the parts' and fingers' volumes, and the contacts allowed by step.
    surface_um : float
        World height of the stage's surface at reading 0.

    Raises
    ------
    ExecutorError
        MP802 if the plan has the volume of something and not its position.
    """

    def __init__(self, plan: Plan, surface_um: float) -> None:
        self._steps = plan.steps
        self._owners = {place.name: place.owner for place in plan.features}
        self._parts = {solid.name: solid.prisms for solid in plan.parts}
        self._fingers = {fingers.tool: fingers for fingers in plan.fingers}
        self._surface_um = surface_um
        known = {belief.name for belief in plan.beliefs}
        unknown = sorted({*self._parts, *self._fingers} - known)
        if unknown:
            raise ExecutorError(
                "MP802", f"the plan does not say where {', '.join(unknown)} is"
            )

    @property
    def known(self) -> bool:
        """Return whether the plan has the volumes of things."""
        return bool(self._parts)

    def check(self, move: AxisMove, now: Moment, step: str) -> None:
        """Raise MP836 if a move would bring two bodies together.

        MP847 if it goes to where no number is.
        """
        check_finite(move.axes, targets(move))
        met = self.met(move, now, self.allowed(step))
        if met is not None:
            data = to_data(move)
            axes = data.pop("axes")
            aim = ", ".join(f"{k} {v:g}" for k, v in data.items() if v is not None)
            raise ExecutorError(
                "MP836", f"{met[0]} would meet {met[1]} as the {axes} goes to {aim}"
            )

    def check_jaws(self, now: Moment, step: str) -> None:
        """Raise MP836 if a motion of the jaws would bring a finger to another part."""
        robot = list(_standing(self._carried("robot", now), "robot", now.readings))
        fingers = [volume for volume in robot if volume.owner in self._fingers]
        parts = [volume for volume in robot if volume.owner not in self._fingers]
        parts += _standing(self._carried("stage", now), "stage", now.readings)
        met = _meeting(fingers, parts, self.allowed(step), 0.0)
        if met is not None:
            first, last = now.openings_um[0], now.openings_um[-1]
            raise ExecutorError(
                "MP836",
                f"{met[0]} would meet {met[1]} as the jaws go from {first:g} to "
                f"{last:g} um",
            )

    def met(
        self,
        move: AxisMove,
        now: Moment,
        allowed: frozenset[Pair] = frozenset(),
        *,
        margin_um: float = 0.0,
    ) -> tuple[str, str] | None:
        """Return the owners that a move brings closer than a margin, None if none."""
        travel = _travel(move, now.readings)
        other: AxesName = "robot" if move.axes == "stage" else "stage"
        still = list(_standing(self._carried(other, now), other, now.readings))
        swept = [
            volume
            for each in self._carried(move.axes, now)
            if any(
                _level(travel.heights_um(each), volume, margin_um) for volume in still
            )
            for volume in travel.covered(each)
        ]
        met = _meeting(swept, still, allowed, margin_um)
        return self._sunk(move, travel, now, allowed) if met is None else met

    def allowed(self, step: str) -> frozenset[Pair]:
        """Return the contacts allowed in a step: what it or an earlier one joined.

        A part and what it is put onto may touch from the step that inserts it, a part
        and the fingers from the step that grasps it.
        """
        ids = [each.id for each in self._steps]
        found: set[Pair] = set()
        for each in self._steps[: ids.index(step) + 1 if step in ids else 0]:
            action = each.action
            if isinstance(action, GraspAction):
                found.add(self._pair(action.target, action.tool))
            elif isinstance(action, InsertAction):
                found.add(self._pair(action.target, action.onto))
                found.add(frozenset((self._owner(action.target), SURFACE)))
        return frozenset(found)

    def _pair(self, one: str, other: str) -> Pair:
        """Return the owners of two names."""
        return frozenset((self._owner(one), self._owner(other)))

    def _owner(self, name: str) -> str:
        """Return the part or tool that a name belongs to."""
        return self._owners.get(name, name.removesuffix(".grip"))

    def _sunk(
        self, move: AxisMove, travel: Travel, now: Moment, allowed: frozenset[Pair]
    ) -> tuple[str, str] | None:
        """Return a part on the robot that would go deeper into the stage's surface.

        The fingers have a rule of their own, MP842.
        """
        rise_um = travel.end.z_um - travel.start.z_um
        nearer_um = rise_um if move.axes == "stage" else -rise_um
        if not self.known or nearer_um <= 0 or now.readings.robot is None:
            return None
        robot_um = now.readings.robot.z_um
        surface_um = self._surface_um + now.readings.stage.z_um
        for volume in self._carried("robot", now):
            gap_um = volume.low_um + robot_um - surface_um - nearer_um
            free = volume.owner in self._fingers or gap_um >= -ROUNDING_UM
            if not free and frozenset((volume.owner, SURFACE)) not in allowed:
                return volume.owner, SURFACE
        return None

    def _carried(self, axes: AxesName, now: Moment) -> Iterator[SweptVolume]:
        """Yield what an axis group carries, where that is with the axes at 0."""
        for name, prisms in self._parts.items():
            if now.beliefs.belief(name).carrier == axes:
                knows = now.beliefs.knows_angle(name)
                for prism in prisms:
                    if prism.high_um > prism.low_um:  # a sheet takes up no volume
                        shape = prism if knows else _around(prism)
                        yield _room(name, shape, now, ((0.0, 0.0),))
        for tool, fingers in self._fingers.items():
            if axes == "robot":
                halves = [opening / 2 for opening in now.openings_um]
                yield _room(tool, fingers.left, now, [(-h, 0.0) for h in halves])
                yield _room(tool, fingers.right, now, [(h, 0.0) for h in halves])


def _room(
    owner: str, prism: Prism, now: Moment, shifts: Sequence[tuple[float, float]]
) -> SweptVolume:
    """Return a prism, shifted in its owner's frame, where its owner is believed."""
    belief = now.beliefs.belief(owner)
    corners = [
        belief.pose.apply(x + dx, y + dy)
        for x, y in prism.corners_um
        for dx, dy in shifts
    ]
    return SweptVolume(
        owner=owner,
        corners_um=np.array(corners) if len(shifts) == 1 else hull(np.array(corners)),
        low_um=belief.z_um + prism.low_um,
        high_um=belief.z_um + prism.high_um,
    )


def _around(prism: Prism) -> Prism:
    """Return a prism that holds another at every angle about the owner's origin."""
    reach_um = max(math.hypot(x, y) for x, y in prism.corners_um)
    radius_um = reach_um / math.cos(math.pi / MOST_CORNERS)
    turns = [math.tau * k / MOST_CORNERS for k in range(MOST_CORNERS)]
    corners = tuple((radius_um * math.cos(t), radius_um * math.sin(t)) for t in turns)
    return replace(prism, corners_um=corners)


def _travel(move: AxisMove, readings: Readings) -> Travel:
    """Return a move's two ends."""
    start = readings.reading(move.axes)
    return Travel(
        start=start,
        end=replace(start, **targets(move)),
        pivot_um=_pivot_um(move.axes, readings),
    )


def _standing(
    volumes: Iterable[SweptVolume], axes: AxesName, readings: Readings
) -> Iterator[SweptVolume]:
    """Yield where volumes that an axis group carries are now."""
    for volume in volumes:
        reading = readings.reading(axes)
        pivot_um = _pivot_um(axes, readings)
        yield from Travel(start=reading, end=reading, pivot_um=pivot_um).covered(volume)


def _pivot_um(axes: AxesName, readings: Readings) -> tuple[float, float]:
    """Return the point, um, that an axis group rotates about at reading 0."""
    return readings.theta_axis_um if axes == "stage" else (0.0, 0.0)


def _level(
    heights_um: tuple[float, float], volume: SweptVolume, margin_um: float
) -> bool:
    """Return whether a range of heights comes within a margin of a volume's."""
    low_um, high_um = heights_um
    return max(low_um - volume.high_um, volume.low_um - high_um) < margin_um


def _meeting(
    moving: Iterable[SweptVolume],
    still: Sequence[SweptVolume],
    allowed: frozenset[Pair],
    margin_um: float,
) -> tuple[str, str] | None:
    """Return the owners of the first two volumes that meet and may not."""
    for volume in moving:
        others = [o for o in still if frozenset((volume.owner, o.owner)) not in allowed]
        found = first_meeting(volume, others, margin_um=margin_um)
        if found is not None:
            return volume.owner, found.owner
    return None
