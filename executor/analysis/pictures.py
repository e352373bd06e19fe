"""Findings of a look's routines in pictures of it, one by one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from microplan.arrays import FloatArray
from microplan.executor.analysis.appearance import (
    Likeness,
    RegionStatistics,
    appearance,
    likeness,
)
from microplan.executor.analysis.picture_file import read_picture
from microplan.executor.devices.calibration import (
    LookFrame,
    in_region,
    look_frame,
    planned_pose,
)
from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import INDEX
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.gates import GateValue, gates_of
from microplan.executor.run.measure_feature import (
    Picture,
    ShownFeature,
    measured,
    spare,
)
from microplan.executor.run.measure_target import light_of
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.fusion import Believed, fuse
from microplan.schemas.plan import Look, Measure, Plan, Region, RoutineUse
from microplan.schemas.pose import Pose

MOST = 10_000  # pictures of a folder
_KNOWN_RAD = math.radians(1)  # how well a user knows an angle he states


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """Result of one chain on one feature of one picture."""

    feature: str
    chain: tuple[str, ...]
    spare: bool  # the fallback
    code: str | None = None  # why it was refused; None: accepted
    why: str = ""
    shown: ShownFeature | None = None  # None: nothing was found
    gates: tuple[GateValue, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Target pose found in one picture, world frame, with all attempts."""

    name: str
    code: str | None  # None: found, and accepted
    why: str
    whole: bool = True  # the picture is the whole frame, not the region alone
    image: FloatArray | None = None  # its light, 0..1 of full scale
    attempts: tuple[Attempt, ...] = ()
    x_um: float | None = None
    y_um: float | None = None
    theta_rad: float | None = None
    looks: Likeness | None = None
    hint: str = ""  # of its full scale

    @property
    def found(self) -> bool:
        """Return whether the target was found and accepted."""
        return self.code is None

    @property
    def spare_used(self) -> bool:
        """Return whether a fallback had to find it."""
        return any(a.spare and a.code is None for a in self.attempts)


@dataclass(slots=True, kw_only=True)
class Viewer:
    """Measures pictures of one look: the plan, its routines and what is expected."""

    plan: Plan
    look: Look
    artifacts: Artifacts
    expected: Pose  # of the look's target
    believed: Believed | None
    reference: RegionStatistics | None  # None: the plan's image is not there
    bits: int | None = None

    @property
    def frame(self) -> LookFrame:
        """Return the map between the look's planned region and the world."""
        return look_frame(self.look, self.plan.requirements, None)

    def reading(self, region: Region | None) -> Viewer:
        """Return the viewer of a picture of which a run measured a region.

        A look that follows reads it where its target was believed; None: not known.
        What cannot be its region is passed over.
        """
        planned, need = self.look.measure.region, self.plan.requirements
        if region is None or not self.look.view.follows:
            return self
        if region != replace(planned, row=region.row, column=region.column):
            return self
        if not (
            0 <= region.row <= need.height_px - region.rows
            and 0 <= region.column <= need.width_px - region.columns
        ):
            return self
        look = in_region(self.look, region, self.frame)
        before, now = planned_pose(self.look.measure), planned_pose(look.measure)
        expected = replace(
            self.expected,
            x_um=self.expected.x_um + now.x_um - before.x_um,
            y_um=self.expected.y_um + now.y_um - before.y_um,
        )
        return replace(self, look=look, expected=expected)


def viewer(
    plan: Plan,
    folder: Path,
    artifacts: Artifacts,
    look_id: str,
    *,
    turn_rad: float | None = None,
    bits: int | None = None,
) -> Viewer:
    """Return the viewer that measures pictures of a look.

    The target is expected where the plan has it. Its angle counts as unknown where the
    plan starts so, unless `turn_rad` states it.

    Raises
    ------
    ExecutorError
        MP878 if the plan has no such look.
    """
    looks = {look.id: look for step in plan.steps for look in step.looks}
    if look_id not in looks:
        known = ", ".join(looks) or "none"
        raise ExecutorError("MP878", f"no look {look_id!r}; the plan has: {known}")
    look = looks[look_id]
    expected = _expected(look.measure, turn_rad)
    return Viewer(
        plan=plan,
        look=look,
        artifacts=artifacts,
        expected=expected,
        believed=_believed(plan, look, expected, turn_rad),
        reference=_reference(plan, look, folder),
        bits=bits,
    )


def files_of(folder: Path) -> list[Path]:
    """Return the files of a folder by name; MP878 if there are none, or too many.

    Those whose names begin with a dot are the file manager's; a run's list of its
    frames is no picture.
    """
    with failing("MP878", folder):
        found = sorted(
            path
            for path in folder.iterdir()
            if path.is_file() and not path.name.startswith(".") and path.name != INDEX
        )
    if not found:
        raise ExecutorError("MP878", f"{folder} holds no file", place=folder)
    if len(found) > MOST:
        raise ExecutorError(
            "MP878", f"{folder} holds {len(found)} files, at most {MOST}"
        )
    return found


def find_in(seer: Viewer, path: Path) -> Finding:
    """Return the finding of a picture; an unusable one is reported, not raised."""
    look, region = seer.look, seer.look.measure.region
    try:
        read = read_picture(path, seer.plan.requirements, region, seer.bits)
    except ExecutorError as error:
        return Finding(name=path.name, code=error.code, why=error.message)
    image = _light(read.image, seer.plan)
    part = cut(image, region)
    picture = Picture(
        image=part,
        frame=seer.frame,
        expected=seer.expected,
        believed=seer.believed,
    )
    attempts = [a for m in look.measures for a in _attempts(seer, m, picture)]
    code, why, found_pose = _together(seer, attempts)
    x_um, y_um, theta_rad = found_pose
    return Finding(
        name=path.name,
        code=code,
        why=why,
        whole=part is not image,
        image=image,
        hint=read.hint,
        attempts=tuple(attempts),
        x_um=x_um,
        y_um=y_um,
        theta_rad=theta_rad,
        looks=None
        if seer.reference is None
        else likeness(appearance(part), seer.reference),
    )


def cut(image: FloatArray, region: Region) -> FloatArray:
    """Return the region of a picture, (rows, columns), 0..1; it may be all of it."""
    if image.shape == (region.rows, region.columns):
        return image
    rows = slice(region.row, region.row + region.rows)
    return image[rows, region.column : region.column + region.columns]


def _attempts(seer: Viewer, measure: Measure, picture: Picture) -> list[Attempt]:
    """Return what the chain, and if it is refused the fallback, make of a feature."""
    first = _attempt(seer, measure, measure.chain, picture, is_spare=False)
    if first.code is None or not measure.fallback:
        return [first]
    other = spare(measure)
    return [first, _attempt(seer, other, measure.fallback, picture, is_spare=True)]


def _attempt(
    seer: Viewer,
    measure: Measure,
    uses: Sequence[RoutineUse],
    picture: Picture,
    *,
    is_spare: bool,
) -> Attempt:
    """Return what one chain makes of a feature, with every gate."""
    name = measure.feature or seer.look.target
    attempt = Attempt(feature=name, chain=tuple(use.id for use in uses), spare=is_spare)
    try:
        shown = measured(seer.artifacts, seer.look, measure, uses, picture)
    except ExecutorError as error:
        return replace(attempt, code=error.code, why=error.message)
    gates = gates_of(
        measure, shown.score, shown.spread_um, shown.seen, picture.expected
    )
    bad = [gate for gate in gates if not gate.passed]
    return replace(
        attempt,
        code=bad[0].code if bad else None,
        why="; ".join(f"{name} {gate.words}" for gate in bad),
        shown=shown,
        gates=gates,
    )


def _together(
    seer: Viewer, attempts: Sequence[Attempt]
) -> tuple[str | None, str, tuple[float | None, float | None, float | None]]:
    """Return code, reason and position by all features that were accepted."""
    look, nowhere = seer.look, (None, None, None)
    good = [a.shown.seen for a in attempts if a.code is None and a.shown is not None]
    least = len(look.measures) if look.together is None else look.together.least
    if len(good) < max(least, 1):
        bad = [a for a in attempts if a.code is not None]
        words = "; ".join(f"{', '.join(a.chain)}: {a.why}" for a in bad)
        return bad[0].code, words, nowhere
    pose = fuse(good, seer.believed)
    if isinstance(pose, Failure):
        return "MP826", pose.message, nowhere
    return None, "", (pose.x_um, pose.y_um, pose.theta_rad)


def _expected(measure: Measure, turn_rad: float | None) -> Pose:
    """Return the expected pose of the look's target, from its first feature's."""
    pose = planned_pose(measure)
    return pose if turn_rad is None else replace(pose, theta_rad=turn_rad)


def _believed(
    plan: Plan, look: Look, expected: Pose, turn_rad: float | None
) -> Believed | None:
    """Return what is known of the target's angle before it is measured."""
    if turn_rad is not None:
        return Believed(theta_rad=turn_rad, sigma_rad=_KNOWN_RAD)
    beliefs = Beliefs(plan.beliefs, plan.features)
    owner = beliefs.owner(look.target)
    sigma = next(b.sigma_theta_rad for b in plan.beliefs if b.name == owner)
    if not beliefs.knows_angle(look.target):
        return None
    return Believed(theta_rad=expected.theta_rad, sigma_rad=sigma)


def _reference(plan: Plan, look: Look, folder: Path) -> RegionStatistics | None:
    """Return how the plan's own image of the look appears, None without one."""
    region = look.measure.region
    try:
        path = folder / look.scene.image
        image = _light(read_picture(path, plan.requirements, region).image, plan)
    except ExecutorError:
        return None
    return appearance(cut(image, region))


def _light(image: FloatArray, plan: Plan) -> FloatArray:
    """Return the light of a picture as read, both as shares of full scale."""
    need = plan.requirements
    return light_of(image * (2**need.bits - 1), need) if need.response else image
