"""The picture of what a whole task's accuracy costs, by `microplan tradeoff --vary`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import IdentityTransform

from microplan.arrays import Point
from microplan.planner.tradeoff.plots import (
    DPI,
    HALO,
    even_ticks,
    front_line,
    new_figure,
    png,
)
from microplan.planner.tradeoff.task_tradeoff_record import Spent, TaskTradeoff
from microplan.schemas.page.labels import Box, PointLabel, placed

_AXIS_MARKS = {
    "as": ("#000000", "o"),
    "preset": ("#0072B2", "s"),
    "trials": ("#E69F00", "^"),
    "frames": ("#009E73", "D"),
    "zoom": ("#CC79A7", "v"),
}
_MARK_PT = 4.5  # radius of a point's mark, with its rim
_RARE = 1e-4  # chances of failure below are drawn here: no trials tell them


def task_png(found: TaskTradeoff, spent: Sequence[Spent]) -> bytes:
    """Return error, and chance of failure, over what compiling takes, as PNG."""
    return png(task_figure(found, spent))


def task_figure(found: TaskTradeoff, spent: Sequence[Spent]) -> Figure:
    """Return the picture that `task_png` writes.

    Bars reach from the chance as predicted to that with silent failures at their bound.
    Points without a plan that is complete are left out.
    """
    figure = new_figure(11.0, 5.0)
    left, right = figure.subplots(1, 2)
    pairs = [
        (point, took)
        for point, took in zip(found.points, spent, strict=True)
        if point.error_um is not None
    ]
    risks = list[tuple[float, float, float]]()
    for point, took in pairs:
        color, shape = _AXIS_MARKS[point.varied.partition(" ")[0]]
        error = point.error_um or 0.0
        left.plot(took.cpu_s, error, shape, color=color, markersize=8)
        misses = [
            max(1 - (chance or 0.0), _RARE)
            for chance in (point.success_probability, point.success_lower)
        ]
        right.plot([took.cpu_s] * 2, misses, "-", color=color, linewidth=1.2)
        right.plot(took.cpu_s, misses[0], shape, color=color, markersize=8)
        risks.append((took.cpu_s, misses[0], misses[1]))
    front = [(t.cpu_s, p.error_um or 0.0) for p, t in pairs if t.on_front]
    front_line(left, front)
    left.set_title("one sigma per axis where the last part goes", fontsize=11)
    left.set_ylabel("error [um]")
    right.set_title("1 - P(success), up to silent failures at their bound", fontsize=11)
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("compile time [s of CPU, this machine]")
        axes.margins(x=0.25, y=0.12)
        axes.grid(visible=True, which="major", alpha=0.35)
        even_ticks(axes)
    figure.suptitle(f"{found.task}: what accuracy costs")
    figure.draw_without_rendering()  # from here on places are known
    varied = [point.varied for point, _ in pairs]
    errors = [(took.cpu_s, point.error_um or 0.0) for point, took in pairs]
    _names(left, varied, errors, _stairs(front))
    bars = [((x, low), (x, high)) for x, low, high in risks]
    _names(right, varied, [(x, low) for x, low, _ in risks], bars)
    return figure


def _names(
    axes: Axes,
    names: Sequence[str],
    points: Sequence[Point],
    lines: Sequence[tuple[Point, Point]],
) -> None:
    """Write names near their points, none over another or over a mark.

    One that has no room stands beside its mark all the same.
    """
    shown = axes.transData

    def at(point: Point) -> Point:  # pixels, downwards
        x, y = shown.transform(point)
        return float(x), -float(y)

    frame, mark = axes.get_window_extent(), _MARK_PT * DPI / 72
    texts = [
        axes.annotate(name, (0, 0), xycoords="figure pixels", va="bottom", fontsize=8)
        for name in names
    ]
    sizes = [text.get_window_extent() for text in texts]
    spots = [at(point) for point in points]
    found = placed(
        [
            PointLabel(at=spot, width=size.width, mark=mark)
            for spot, size in zip(spots, sizes, strict=True)
        ],
        height=max((size.height for size in sizes), default=0.0),
        field=Box(left=frame.x0, top=-frame.y1, right=frame.x1, bottom=-frame.y0),
        taken=[Box(left=x, top=y, right=x, bottom=y).grown(mark) for x, y in spots],
        lines=[(at(start), at(end)) for start, end in lines],
    )
    for text, spot, place in zip(texts, spots, found, strict=True):
        box = None if place is None else place.box
        text.set_position(
            (spot[0] + mark, -spot[1]) if box is None else (box.left, -box.bottom)
        )
        text.set_in_layout(False)
        text.set_path_effects([HALO])
        if place is not None and place.leader is not None:
            (x0, y0), (x1, y1) = place.leader
            line = Line2D([x0, x1], [-y0, -y1], color="0.4", linewidth=0.8, zorder=1)
            line.set_transform(IdentityTransform())
            axes.add_artist(line)


def _stairs(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Return the lines of a front: on at the same error, then down."""
    return [
        line
        for (x0, y0), (x1, y1) in pairwise(sorted(points))
        for line in (((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)))
    ]
