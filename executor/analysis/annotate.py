"""Marked pictures: what was found, drawn into the user's own."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from microplan.executor.analysis.pictures import Attempt, Finding, Viewer
from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.record.plan_file import world_beside
from microplan.schemas.pose import Pose

_world = cache(world_beside)
Marked = npt.NDArray[np.uint8]

GREEN, RED, YELLOW, GREY = (80, 220, 80), (60, 60, 255), (0, 200, 255), (150, 150, 150)
_MOST_NAME = 255  # bytes, of common file systems
_SMALL_PX = 400  # a picture with a shorter side is shown larger
_ARC_PX = 2.0  # between points of an arc that is drawn


def mark(seer: Viewer, finding: Finding, folder: Path) -> Marked | None:
    """Return a picture with region, cross, outline and words; None without a picture.

    Green is what was accepted, red what was refused; grey is where the plan has the
    features, with a circle about the range in which they can be found. The outline is
    that of the plan folder's world.json, if it is there.
    """
    import cv2  # heavy, and only this mode draws

    if finding.image is None:
        return None
    height, width = finding.image.shape
    times = max(1, math.ceil(_SMALL_PX / max(min(height, width), 1)))
    times = min(times, 8)
    grey = np.clip(finding.image * 255, 0, 255).astype(np.uint8)
    large = grey.repeat(times, axis=0).repeat(times, axis=1)
    picture = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    place = _Enlarged(seer, finding, times)
    region = seer.look.measure.region
    if finding.whole:
        first = place.on_picture(-0.5, -0.5)
        last = place.on_picture(region.columns - 0.5, region.rows - 0.5)
        cv2.rectangle(picture, first, last, YELLOW, 1)
    for measure in seer.look.measures:
        at = place.of_world(*seer.expected.apply(*measure.offset_um))
        _cross(picture, at, GREY, 5)
        reach_px = times * measure.capture_um / seer.look.view.um_per_px
        if reach_px < max(picture.shape):
            cv2.circle(picture, at, round(reach_px), GREY, 1)
    for attempt in finding.attempts:
        _draw(picture, place, attempt, folder)
    _words(picture, finding)
    drawn: Marked = np.asarray(picture, dtype=np.uint8)
    return drawn


def write_marked(folder: Path, name: str, picture: Marked) -> None:
    """Write one marked picture as PNG, by its own name; MP878 if that fails."""
    import cv2  # as above

    done, data = cv2.imencode(".png", picture)
    path = folder / (name if name.lower().endswith(".png") else f"{name}.png")
    if len(os.fsencode(path.name)) > _MOST_NAME:
        size = f"{len(os.fsencode(name))} bytes"
        raise ExecutorError(
            "MP878",
            f"{name[:40]}...: its name has {size}; {_MOST_NAME - 4} leave room "
            "for .png, so give the picture a shorter one",
        )
    with failing("MP878", path):
        folder.mkdir(parents=True, exist_ok=True)
        if not done:
            raise OSError("it cannot be encoded")
        path.write_bytes(data.tobytes())


class _Enlarged:
    """World um and pixels of the region to points of the enlarged picture."""

    def __init__(self, seer: Viewer, finding: Finding, times: int) -> None:
        self.seer, self._times = seer, times
        region = seer.look.measure.region
        self._shift = (region.column, region.row) if finding.whole else (0, 0)

    def on_picture(self, column: float, row: float) -> tuple[int, int]:
        """Return the point of a pixel of the region; whole numbers are its middle."""
        return (
            round((column + self._shift[0] + 0.5) * self._times - 0.5),
            round((row + self._shift[1] + 0.5) * self._times - 0.5),
        )

    def of_world(self, x_um: float, y_um: float) -> tuple[int, int]:
        """Return the picture's point of a world position, um."""
        column, row = self.seer.frame.to_pixel(x_um, y_um)
        return self.on_picture(column, row)


def _draw(picture: Any, place: _Enlarged, attempt: Attempt, folder: Path) -> None:
    """Draw where one chain found its feature."""
    import cv2  # as above

    if attempt.shown is None:
        return
    seen, colour = attempt.shown.seen, GREEN if attempt.code is None else RED
    values = (seen.x_um, seen.y_um)
    if not all(math.isfinite(v) for v in values):
        return
    _cross(picture, place.of_world(*values), colour, 9)
    theta = seen.theta_rad
    if theta is None and place.seer.believed is not None:
        theta = place.seer.believed.theta_rad
    if theta is None:
        return
    pose = Pose(x_um=seen.x_um, y_um=seen.y_um, theta_rad=theta)
    for ring in rings_of(place.seer, attempt.feature, folder):
        points = [place.of_world(*pose.apply(x, y)) for x, y in ring]
        line = [np.array(points, dtype=np.int32)]
        cv2.polylines(picture, line, isClosed=True, color=colour, thickness=1)


def rings_of(
    seer: Viewer, feature: str, folder: Path
) -> list[list[tuple[float, float]]]:
    """Return the rings of a post or part about a feature, um; none of a tool."""
    world = _world(folder)
    owner, _, _ = feature.partition(".")
    parts = () if world is None else world.parts
    part = next((p for p in parts if p.name == owner), None)
    if part is None:
        return []
    posts = [post.outline for post in part.posts if post.name == feature]
    outline = posts[0] if posts else part.outline
    places = {f.name: (f.x_um, f.y_um) for f in seer.plan.features}
    at = places.get(feature, (0.0, 0.0))
    step_um = _ARC_PX * seer.look.view.um_per_px
    return [
        [
            (x - at[0], y - at[1])
            for edge in ring.edges
            for x, y in _points(edge, step_um)
        ]
        for ring in outline.rings
    ]


def _points(edge: Sequence[float], step_um: float) -> list[tuple[float, float]]:
    """Return points along a segment (x, y, x, y) or an arc (x, y, r, start, sweep)."""
    if len(edge) == 4:
        return [(edge[0], edge[1])]
    x, y, radius, start, sweep = edge
    count = min(max(math.ceil(abs(sweep) * radius / step_um), 2), 2000)
    return [
        (
            x + radius * math.cos(start + sweep * k / count),
            y + radius * math.sin(start + sweep * k / count),
        )
        for k in range(count)
    ]


def _cross(picture: Any, at: tuple[int, int], colour: Any, half: int) -> None:
    """Draw a cross."""
    import cv2  # as above

    x, y = at
    cv2.line(picture, (x - half, y), (x + half, y), colour, 1)
    cv2.line(picture, (x, y - half), (x, y + half), colour, 1)


def _words(picture: Any, finding: Finding) -> None:
    """Write the result into the upper left corner."""
    import cv2  # as above

    colour = GREEN if finding.found else RED
    words = f"{finding.code}"
    if finding.found:
        words = f"x {finding.x_um:.3f} um  y {finding.y_um:.3f} um"
        if finding.theta_rad is not None:
            words += f"  turn {math.degrees(finding.theta_rad):.2f} deg"
    for ink, thick in (((0, 0, 0), 3), (colour, 1)):
        cv2.putText(
            picture, words, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, ink, thick,
            cv2.LINE_AA,
        )  # fmt: skip
