"""A target's visible edges in pieces, each with polarity and contrast."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contour.polarity import (
    FAINT,
    Prediction,
    profiles,
    worth,
)
from microplan.featuresel.routines.sampling import STEP_PX, WIDTHS_PX, edge_kernel
from microplan.optics.outline.outline import Edge, Ring, Segment
from microplan.planner.export.folder import ExportedPlan, Viewed
from microplan.planner.export.sight import LookProjection, sight_of, target_rings
from microplan.planner.export.tracks import RingTrack, SampleRun, border, runs
from microplan.planner.store.pictures import Picture
from microplan.schemas.files.outlines import (
    ArcEdge,
    EdgePiece,
    LookOutlines,
    Polarity,
    SegmentEdge,
)
from microplan.schemas.pose import Pose

SPACING_PX = 0.5  # of samples along the edges: an image holds no finer detail
MOST = 200_000  # samples of a look: a finger of 2e4 um all round at a fifth of a um
_TOGETHER = 10_000  # samples whose profiles are held at once
_FEW = 2_000  # samples that a filter is chosen by
_WIDTHS_PX = WIDTHS_PX[:4]  # as `polarity.predict`: wider ones blur fine parts
_WEAKEST = 0.15  # of the strongest tenth: less is the ring of another edge's blur
_LEAST_PX = 3.0  # of a piece between two alike: about what the filters reach
_HIDDEN, _OUTSIDE = -2, -1
_POLARITIES: tuple[Polarity, ...] = ("unclear", "dark_to_light", "light_to_dark")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sampled:
    """One ring sampled: where, seen or not, and how the image steps there."""

    body: str
    line: RingTrack  # in the world
    way_um: FloatArray  # (N,) middles of equal lengths
    points: FloatArray  # (N, 4) world
    covered: BoolArray
    seen: BoolArray

    @property
    def spacing_um(self) -> float:
        """Return the length that one sample stands for."""
        return self.line.length_um / len(self.way_um)


def look_outlines(folder: ExportedPlan, viewed: Viewed) -> LookOutlines:
    """Return what of a look's target is seen, and how.

    Raises
    ------
    ExportError
        MP721 if the folder's files do not fit each other.

    Notes
    -----
    An edge is hidden where a higher body lies above it. The step of brightness across
    it, from inside the material to outside, is the response of a Gaussian derivative
    of which a unit step gives 1, along the edge's normal in the reference image. The
    filter is the one that would fix the target best (Canny 1986), as in
    `microplan.featuresel.routines.contour.polarity`.
    """
    look, pose = viewed.look, viewed.scene.target.pose
    sight = sight_of(folder, viewed)
    tracks = _tracks(target_rings(folder, viewed), sight)
    image = folder.picture(look)
    width_px, steps = _steps(image, sight, tracks)
    faintest = _faintest(steps, tracks)
    found: list[EdgePiece] = []
    for track, step in zip(tracks, steps, strict=True):
        found += _pieces(track, sight, step, faintest, pose)
    origin = sight.pixels(np.array([[pose.x_um, pose.y_um, 1.0, 0.0]]))[0]
    return LookOutlines(
        look=look.id,
        step=viewed.step.id,
        target=viewed.scene.target.name,
        pose=pose,
        column_px=float(origin[0]),
        row_px=float(origin[1]),
        um_per_px=look.view.um_per_px,
        magnification=look.view.magnification,
        focus_um=look.view.focus_um,
        light=look.view.light,
        image=look.scene.image,
        image_sha256=look.scene.image_sha256,
        filter_px=width_px,
        length_um=sum(track.line.length_um for track in tracks),
        hidden_um=sum(t.spacing_um * int(t.covered.sum()) for t in tracks),
        outside_um=sum(
            t.spacing_um * int((~t.covered & ~t.seen).sum()) for t in tracks
        ),
        pieces=tuple(found),
    )


def _tracks(rings: Sequence[tuple[str, Ring]], sight: LookProjection) -> list[_Sampled]:
    """Return the rings of a target, sampled evenly."""
    lines = [(body, RingTrack(ring)) for body, ring in rings]
    total_um = sum(line.length_um for _, line in lines)
    spacing_um = max(SPACING_PX * sight.microscope.um_per_px, total_um / MOST)
    found = []
    for body, line in lines:
        count = max(math.ceil(line.length_um / spacing_um), 8)
        way = (np.arange(count) + 0.5) * line.length_um / count
        points = line.along(way)
        covered = sight.covered(points)
        found.append(
            _Sampled(
                body=body,
                line=line,
                way_um=way,
                points=points,
                covered=covered,
                seen=sight.framed(points) & ~covered,
            )
        )
    return found


def _steps(
    image: Picture, sight: LookProjection, tracks: Sequence[_Sampled]
) -> tuple[float, list[FloatArray]]:
    """Return the filter's width, and every sample's step; 0 where none is seen."""
    light = image.astype(np.float64) / 255
    where = np.concatenate([sight.pixels(t.points[t.seen]) for t in tracks])
    if len(where) == 0:
        return _WIDTHS_PX[0], [np.zeros(len(t.way_um)) for t in tracks]
    few = where[:: math.ceil(len(where) / _FEW)]
    width_px = max(_WIDTHS_PX, key=lambda width: _worth(light, few, width))
    found = []
    for track in tracks:
        step = np.zeros(len(track.way_um))
        step[track.seen] = _response(
            light, sight.pixels(track.points[track.seen]), width_px
        )
        found.append(step)
    return width_px, found


def _response(light: FloatArray, where: FloatArray, width_px: float) -> FloatArray:
    """Return the step of brightness outwards at (N, 4) column, row, normal in px."""
    kernel = edge_kernel(width_px)
    half_px = len(kernel) // 2 * STEP_PX
    found = np.empty(len(where))
    for first in range(0, len(where), _TOGETHER):
        some = slice(first, first + _TOGETHER)
        found[some] = profiles(light, where[some], half_px) @ kernel
    return np.nan_to_num(found)


def _worth(light: FloatArray, where: FloatArray, width_px: float) -> float:
    """Return how well the edges would fix the target through one filter."""
    step = _response(light, where, width_px)
    seen = Prediction(
        step=step,
        offset_px=np.zeros(len(step)),
        kept=np.abs(step) >= FAINT,
        width_px=width_px,
    )
    return worth(light, where, seen)


def _faintest(steps: Sequence[FloatArray], tracks: Sequence[_Sampled]) -> float:
    """Return the least step of which the sign can be relied on."""
    seen = np.concatenate([s[t.seen] for s, t in zip(steps, tracks, strict=True)])
    if len(seen) == 0:
        return FAINT
    return max(FAINT, _WEAKEST * float(np.percentile(np.abs(seen), 90)))


def _pieces(
    track: _Sampled,
    sight: LookProjection,
    step: FloatArray,
    faintest: float,
    pose: Pose,
) -> list[EdgePiece]:
    """Return the pieces of one ring in the target's frame."""
    kinds = np.where(np.abs(step) < faintest, 0, np.where(step > 0, 1, 2))
    kinds[~track.seen] = _OUTSIDE
    kinds[track.covered] = _HIDDEN
    least = math.ceil(_LEAST_PX * sight.microscope.um_per_px / track.spacing_um)
    found = runs(kinds.astype(np.int64), least)
    ways = _ways(track, sight, found)
    return [
        _piece(track, run, ends, step, pose)
        for run, ends in zip(found, ways, strict=True)
        if run.kind >= 0
    ]


def _ways(
    track: _Sampled, sight: LookProjection, found: Sequence[SampleRun]
) -> list[tuple[float, float]]:
    """Return where each run begins and ends along the ring, um.

    Where an edge goes under a body or out of the frame the place is found exactly, else
    it is midway between two samples.
    """
    length, step = track.line.length_um, track.spacing_um
    if len(found) == 1:
        return [(0.0, length)]
    first = (np.array([run.first for run in found]) + 0.5) * step
    last = (np.array([run.last for run in found]) + 0.5) * step

    def seen(way_um: FloatArray) -> BoolArray:
        points = track.line.along(way_um)
        return sight.framed(points) & ~sight.covered(points)

    own = np.array([run.kind >= 0 for run in found])
    leaves = own & ~np.roll(own, -1)  # the next one is not seen
    enters = own & ~np.roll(own, 1)
    begin, end = first - step / 2, last + step / 2
    begin[enters] = border(seen, first[enters], first[enters] - step)
    end[leaves] = border(seen, last[leaves], last[leaves] + step)
    shift = np.where(begin < 0, length, 0.0)
    return list(zip((begin + shift).tolist(), (end + shift).tolist(), strict=True))


def _piece(
    track: _Sampled,
    run: SampleRun,
    ends: tuple[float, float],
    step: FloatArray,
    pose: Pose,
) -> EdgePiece:
    """Return one piece in the target's frame."""
    own = step[np.arange(run.first, run.last + 1) % len(step)]
    closed = run.samples == len(step)
    edges = track.line.ring.edges if closed else track.line.stretch(*ends)
    back = pose.inverse()
    return EdgePiece(
        body=track.body,
        polarity=_POLARITIES[run.kind],
        contrast=abs(float(own.mean())),
        least_contrast=float(np.abs(own).min()),
        closed=closed,
        edges=tuple(_in_frame(edge, back) for edge in edges),
    )


def _in_frame(edge: Edge, frame: Pose) -> SegmentEdge | ArcEdge:
    """Return an edge turned, then shifted."""
    if isinstance(edge, Segment):
        return SegmentEdge(
            start_um=frame.apply(*edge.start), end_um=frame.apply(*edge.end)
        )
    return ArcEdge(
        center_um=frame.apply(*edge.center),
        radius_um=edge.radius_um,
        start_rad=edge.start_rad + frame.theta_rad,
        sweep_rad=edge.sweep_rad,
    )
