"""Plots of image errors over times, for `microplan tradeoff`."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from microplan.arrays import FloatArray, Point
from microplan.planner.tradeoff.tradeoff_record import MeasuredMethod, StepTradeoff

DPI = 110
# Okabe and Ito's colours, distinct also for colour-blind eyes; and shapes, for print.
_MARKS = {
    "geometric": ("#999999", "v"),
    "product": ("#E69F00", "s"),
    "stokseth": ("#56B4E9", "D"),
    "hopkins": ("#0072B2", "^"),
    "exact": ("#009E73", "o"),
}
_FRONT, _LIMIT, _CHOICE = "#000000", "#D55E00", "#CC79A7"
HALO = withStroke(linewidth=2.5, foreground="white")  # of words that lines cross
_LEAST = 1e-9  # errors below are drawn here
_MANY = 300.0  # from end to end of an axis: powers of ten are ticks enough


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """What the camera would see of one target, over focus and zoom."""

    title: str
    focus_um: tuple[float, ...]  # world heights of the plane in focus, by column
    nominal_um: float  # the height that the plan focuses on
    magnifications: tuple[float, ...]  # by row
    um_per_px: tuple[float, ...]  # by row
    images: tuple[tuple[FloatArray, ...], ...]  # [row][column], share of full scale


def tradeoff_png(step: StepTradeoff) -> bytes:
    """Return the picture of a step: error over time, both logarithmic, as PNG.

    On the left the model's error with layers treated alike, to which the limit applies;
    on the right, where layers of different height are in view, all errors together.
    """
    wide = step.has_layers
    figure = new_figure(11.0 if wide else 7.6, 5.2)
    axes = figure.subplots(1, 2 if wide else 1, squeeze=False)[0]
    _law_panel(axes[0], step)
    if wide:
        _layers_panel(axes[1], step)
    figure.suptitle(
        f"{step.step}: {step.target} at {step.magnification:.3g} x, "
        f"{step.columns} x {step.rows} px"
    )
    figure.legend(
        handles=_legend(step), loc="outside lower center", ncols=5, frameon=False
    )
    return png(figure)


def strip_png(strip: Strip) -> bytes:
    """Return images in rows by zoom and columns by focus, with scale bars, as PNG."""
    rows, columns = len(strip.magnifications), len(strip.focus_um)
    height, width = strip.images[0][0].shape
    side = 2.5  # inches a picture is wide
    figure = new_figure(side * columns + 0.6, side * rows * height / width + 0.9)
    grid = figure.subplots(rows, columns, squeeze=False)
    for i, line in enumerate(strip.images):
        for j, image in enumerate(line):
            axes = grid[i][j]
            axes.imshow(image, cmap="gray", vmin=0, vmax=1)
            axes.set_xticks([])
            axes.set_yticks([])
            if i == 0:
                axes.set_title(_focus_label(strip, strip.focus_um[j]), fontsize=10)
        grid[i][0].set_ylabel(f"{strip.magnifications[i]:.3g} x", fontsize=11)
        _scale_bar(grid[i][-1], strip.um_per_px[i], width, height)
    figure.suptitle(strip.title)
    return png(figure)


def _law_panel(axes: Axes, step: StepTradeoff) -> None:
    """Draw errors of model and sampling, the limit, and what is chosen."""
    shown = [w for w in step.ways if w.law_max_error is not None]
    points = [(w.time_ms, w.law_max_error or 0.0) for w in shown]
    _scatter(axes, shown, points, step.law_oracle_error)
    on_front = [p for p, w in zip(points, shown, strict=True) if w.on_law_front]
    front_line(axes, on_front)
    axes.axhline(step.limit, color=_LIMIT, linestyle="--", linewidth=1.3)
    axes.annotate(
        f"limit {step.limit:g}",
        (step.floor_ms, step.limit),  # all points are slower
        xytext=(5, 4),
        textcoords="offset points",
        color=_LIMIT,
        path_effects=[HALO],
    )
    choice = step.choice
    if choice.law_max_error is not None:
        _ring(axes, (choice.time_ms, choice.law_max_error))
    _floor(axes, step.floor_ms)
    low, high = min(step.focus_heights_um), max(step.focus_heights_um)
    focus = f"{low:g} to {high:g}" if high > low else f"{low:g}"
    axes.set_title(f"law and sampling, focus {focus} um", fontsize=11)
    axes.set_ylabel("largest error [of unit contrast]")
    even_ticks(axes)


def _layers_panel(axes: Axes, step: StepTradeoff) -> None:
    """Draw all errors together, against layers that hide one another."""
    points = [(w.time_ms, w.max_error) for w in step.ways]
    _scatter(axes, step.ways, points, step.oracle_error)
    on_front = [p for p, w in zip(points, step.ways, strict=True) if w.on_front]
    front_line(axes, on_front)
    _ring(axes, (step.choice.time_ms, step.choice.max_error))
    _floor(axes, step.floor_ms)
    axes.set_title(f"with hidden layers, focus {step.focus_um:g} um", fontsize=11)
    even_ticks(axes)


def _scatter(
    axes: Axes,
    methods: Sequence[MeasuredMethod],
    points: Sequence[Point],
    oracle: float,
) -> None:
    """Draw all methods on logarithmic axes; shade what the oracle cannot resolve."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    for method, (time_ms, error) in zip(methods, points, strict=True):
        color, shape = _MARKS[method.model]
        occluded = bool(method.rays_per_cell)
        axes.plot(
            time_ms,
            max(error, _LEAST),
            shape,
            color=color,
            markerfacecolor="white" if method.float_bits == 32 else color,
            markeredgecolor="black" if occluded else color,
            markeredgewidth=1.4 if occluded else 1.0,
            markersize=8 if occluded else 6,
        )
    least = min(max(error, _LEAST) for _, error in points)
    oracle = max(oracle, _LEAST)  # 0 where nothing differs from the background
    bottom = min(least, oracle) / 3
    axes.axhspan(bottom, oracle, color="0.9", zorder=0)
    axes.annotate(
        "below the oracle's own error",
        (1.0, oracle),
        xycoords=("axes fraction", "data"),
        xytext=(-4, -12),
        textcoords="offset points",
        ha="right",
        color="0.4",
        fontsize=9,
        path_effects=[withStroke(linewidth=2.5, foreground="0.9")],
    )
    axes.set_ylim(bottom=bottom)
    axes.grid(visible=True, which="major", alpha=0.35)
    axes.set_xlabel("time of one image [ms of CPU]")


def even_ticks(axes: Axes) -> None:
    """Write powers of ten, and 2 and 5 times them where there are few."""
    for axis, limits in (
        (axes.xaxis, axes.get_xlim()),
        (axes.yaxis, axes.get_ylim()),
    ):
        many = limits[1] / limits[0] > _MANY
        axis.set_major_locator(LogLocator(subs=(1.0,) if many else (1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def front_line(axes: Axes, points: Sequence[Point]) -> None:
    """Draw a Pareto front as stairs: what is to be had for a given time."""
    if not points:
        return
    ordered = sorted(points)
    times, errors = zip(*ordered, strict=True)
    shown = [max(error, _LEAST) for error in errors]
    axes.step(times, shown, where="post", color=_FRONT, linewidth=1.0, zorder=1)


def _ring(axes: Axes, point: Point) -> None:
    """Mark the compiler's choice."""
    axes.plot(
        point[0],
        max(point[1], _LEAST),
        "o",
        markersize=16,
        markerfacecolor="none",
        markeredgecolor=_CHOICE,
        markeredgewidth=2.5,
    )


def _floor(axes: Axes, floor_ms: float) -> None:
    """Draw the time of one transform of the region, there and back."""
    axes.axvline(floor_ms, color="0.4", linestyle=":", linewidth=1.3)
    axes.annotate(
        "one FFT and back",
        (floor_ms, 0.98),
        xycoords=("data", "axes fraction"),
        xytext=(4, 0),
        textcoords="offset points",
        rotation=90,
        va="top",
        color="0.4",
        fontsize=9,
        path_effects=[HALO],
    )


def _legend(step: StepTradeoff) -> list[Line2D]:
    """Return what the marks mean."""
    found = [
        _mark(model, shape, face=color, edge=color)
        for model, (color, shape) in _MARKS.items()
    ]
    found.append(_mark("float32", "o", face="white", edge="0.3"))
    if step.has_layers:
        found.append(_mark("layers occluded", "o", face="0.7", edge="black"))
    found.append(Line2D([], [], color=_FRONT, linewidth=1.0, label="Pareto front"))
    chosen = _mark("the compiler's choice", "o", face="none", edge=_CHOICE)
    chosen.set(markersize=12, markeredgewidth=2.5)
    return [*found, chosen]


def _mark(label: str, shape: str, *, face: str, edge: str) -> Line2D:
    """Return a mark for the legend."""
    return Line2D(
        [],
        [],
        marker=shape,
        linestyle="none",
        label=label,
        markerfacecolor=face,
        markeredgecolor=edge,
    )


def _focus_label(strip: Strip, focus_um: float) -> str:
    """Return a column's title, with the offset from where the plan focuses."""
    offset = focus_um - strip.nominal_um
    return f"focus {focus_um:g} um ({f'{offset:+g}' if offset else 'as planned'})"


def _scale_bar(axes: Axes, um_per_px: float, width: int, height: int) -> None:
    """Draw a bar of a round length, about a quarter of the picture."""
    length_um = round_down(0.3 * width * um_per_px)
    right, y = 0.95 * width, 0.93 * height
    left = right - length_um / um_per_px
    axes.plot([left, right], [y, y], color="white", linewidth=5)
    axes.plot([left, right], [y, y], color="black", linewidth=2.5)
    axes.text(
        (left + right) / 2,
        y - 0.03 * height,
        f"{length_um:g} um",
        ha="center",
        va="bottom",
        fontsize=9,
        bbox={"facecolor": "white", "alpha": 0.75, "pad": 1.5, "edgecolor": "none"},
    )


def round_down(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(d * power for d in (1, 2, 5) if d * power <= value * (1 + 1e-12)))


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure of a size, in."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG file, the same bytes for the same figure."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()
