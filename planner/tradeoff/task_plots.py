"""The picture of what a whole task's accuracy costs, by `microplan tradeoff --vary`."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

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
from microplan.schemas.page.labels import number_boxes

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
    figure = new_figure(11.0, 5.4)
    left, right = figure.subplots(1, 2)
    pairs = [
        (point, took)
        for point, took in zip(found.points, spent, strict=True)
        if point.error_um is not None
    ]
    risks = list[Point]()
    for point, took in pairs:
        color, shape = _mark(point.varied)
        error = point.error_um or 0.0
        left.plot(took.cpu_s, error, shape, color=color, markersize=8)
        misses = [
            max(1 - (chance or 0.0), _RARE)
            for chance in (point.success_probability, point.success_lower)
        ]
        right.plot([took.cpu_s] * 2, misses, "-", color=color, linewidth=1.2)
        right.plot(took.cpu_s, misses[0], shape, color=color, markersize=8)
        risks.append((took.cpu_s, misses[0]))
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
    figure.legend(
        handles=[_entry(n, point.varied) for n, (point, _) in enumerate(pairs, 1)],
        loc="outside lower center", ncols=3, frameon=False,
    )  # fmt: skip
    figure.draw_without_rendering()  # from here on the axes' boxes are known
    if pairs:
        _numbers(left, [(took.cpu_s, point.error_um or 0.0) for point, took in pairs])
        _numbers(right, risks)
    return figure


def _mark(varied: str) -> tuple[str, str]:
    """Return colour and shape of a point's mark."""
    return _AXIS_MARKS[varied.partition(" ")[0]]


def _entry(number: int, varied: str) -> Line2D:
    """Return a point's entry in the legend: its number, its mark and what varied."""
    color, shape = _mark(varied)
    return Line2D([], [], marker=shape, color=color, linestyle="none",
                  label=f"{number}  {varied}")  # fmt: skip


def _numbers(axes: Axes, points: Sequence[Point]) -> None:
    """Write the numbers of points beside their marks, none over another or a mark."""
    mark = _MARK_PT * DPI / 72  # px, as all boxes here, downwards
    shown = axes.transData.transform(points)
    texts = [
        axes.annotate(str(n), (0, 0), xycoords="figure pixels", ha="center",
                      va="center", fontsize=8, path_effects=[HALO])
        for n in range(1, len(points) + 1)
    ]  # fmt: skip
    sizes = [text.get_window_extent() for text in texts]
    boxes = number_boxes(
        [(float(x), -float(y)) for x, y in shown],
        size=(max(s.width for s in sizes), max(s.height for s in sizes)),
        mark=mark,
    )
    for text, box in zip(texts, boxes, strict=True):
        text.set_position(((box.left + box.right) / 2, -(box.top + box.bottom) / 2))
        text.set_in_layout(False)
