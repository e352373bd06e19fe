"""Plot of a whole task's accuracy over compile time, for `tradeoff --vary`."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from microplan.arrays import Point
from microplan.planner.tradeoff.plots import (
    HALO,
    even_ticks,
    front_line,
    new_figure,
    png,
)
from microplan.planner.tradeoff.task_tradeoff_record import Spent, TaskTradeoff

_AXIS_MARKS = {
    "as": ("#000000", "o"),
    "preset": ("#0072B2", "s"),
    "trials": ("#E69F00", "^"),
    "frames": ("#009E73", "D"),
    "zoom": ("#CC79A7", "v"),
}
_CROWD_PX = (45.0, 14.0)  # points nearer than that share a row of numbers
_RARE = 1e-4  # smaller failure probabilities are drawn here: no trials show them


def task_png(found: TaskTradeoff, spent: Sequence[Spent]) -> bytes:
    """Return error, and failure probability, over compile time, as PNG."""
    return png(task_figure(found, spent))


def task_figure(found: TaskTradeoff, spent: Sequence[Spent]) -> Figure:
    """Return the picture that `task_png` writes.

    Bars reach from the predicted probability to that with silent failures at their
    bound.
    Points without a plan that is complete are left out.
    """
    figure = new_figure(11.0, 5.0)
    left, right = figure.subplots(1, 2)
    pairs = [
        (point, took)
        for point, took in zip(found.points, spent, strict=True)
        if point.error_um is not None
    ]
    marks: list[Line2D] = []
    missed: list[Point] = []
    for number, (point, took) in enumerate(pairs, 1):
        color, shape = _AXIS_MARKS[point.varied.partition(" ")[0]]
        marks += left.plot(
            took.cpu_s,
            point.error_um or 0.0,
            shape,
            color=color,
            markersize=8,
            label=f"{number} {point.varied}",
        )
        misses = [
            max(1 - (chance or 0.0), _RARE)
            for chance in (point.success_probability, point.success_lower)
        ]
        right.plot([took.cpu_s] * 2, misses, "-", color=color, linewidth=1.2)
        right.plot(took.cpu_s, misses[0], shape, color=color, markersize=8)
        missed.append((took.cpu_s, misses[0]))
    front_line(left, [(t.cpu_s, p.error_um or 0.0) for p, t in pairs if t.on_front])
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
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False)
    figure.draw_without_rendering()  # from here on pixels are known
    _numbers(left, [(t.cpu_s, p.error_um or 0.0) for p, t in pairs])
    _numbers(right, missed)
    return figure


def _numbers(axes: Axes, points: Sequence[Point]) -> None:
    """Write the numbers of points at their marks, those of one crowd in a row."""
    crowds: list[tuple[Point, Point, list[str]]] = []
    for number, point in enumerate(points, 1):
        x, y = axes.transData.transform(point)
        wide, tall = _CROWD_PX
        near = (
            numbers
            for (u, v), _, numbers in crowds
            if abs(u - x) < wide and abs(v - y) < tall
        )
        row = next(near, None)
        if row is None:
            crowds.append(((float(x), float(y)), point, row := []))
        row.append(str(number))
    for _, point, row in crowds:
        axes.annotate(
            ", ".join(row),
            point,
            xytext=(5, 4),
            textcoords="offset points",
            fontsize=8,
            path_effects=[HALO],
        )
