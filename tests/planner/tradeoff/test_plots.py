"""Pictures of a tradeoff: no number lies on another."""

from __future__ import annotations

from itertools import combinations

from matplotlib.text import Annotation

from microplan.planner.tradeoff.task_plots import task_figure
from microplan.planner.tradeoff.task_tradeoff_record import (
    Spent,
    TaskTradeoff,
    TradeoffPoint,
)

# what was varied, CPU s, error in um: three of them almost in one place
CROWD = (
    ("as the task says", 7.8, 0.0603), ("trials 8", 4.2, 0.0718),
    ("frames 4", 8.19, 0.0572), ("zoom 44.5", 63.4, 0.0369),
    ("preset accurate", 8.0, 0.0601), ("preset balanced", 7.9, 0.0605),
)  # fmt: skip


def test_numbers_of_points_lie_on_no_other() -> None:
    points = tuple(
        TradeoffPoint(varied=name, preset="fast", trials=24, frames=1, zoom=None,
              reason="", status="feasible", error_um=error, success_probability=0.99999,
              success_lower=0.88, run_s=2.7, choices=(), on_front=False)
        for name, _, error in CROWD
    )  # fmt: skip
    spent = [
        Spent(varied=name, cpu_s=cpu_s, wall_s=cpu_s, on_front=error < 0.06)
        for name, cpu_s, error in CROWD
    ]
    figure = task_figure(
        TaskTradeoff(format_version="1.0", task="t", note="", points=points), spent
    )
    figure.draw_without_rendering()
    (legend,) = figure.legends
    rows = [text.get_text() for text in legend.get_texts()]
    assert rows == [f"{k} {name}" for k, (name, *_) in enumerate(CROWD, 1)]
    for axes in figure.axes:
        texts = [text for text in axes.texts if isinstance(text, Annotation)]
        said = ", ".join(text.get_text() for text in texts).split(", ")
        assert sorted(said) == [str(k) for k in range(1, len(CROWD) + 1)]
        boxes = [text.get_window_extent() for text in texts]
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
        frame = axes.get_window_extent()
        assert all(frame.x0 <= b.x0 and b.x1 <= frame.x1 for b in boxes)
