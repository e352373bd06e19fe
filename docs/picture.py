"""Draw the README's picture from a compiled and run example.

python examples/gear_on_shaft/demo.py --out build/demo
python docs/picture.py build/demo/plan build/demo/run docs/images/overview.png
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.image as mpimg
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

BLUE, ORANGE, GREY = "#1f5fa8", "#d9730d", "#555555"
FINEST_RAD = 0.02
TITLES = ("drawing", "predicted image", "focus error it stands", "plan", "run")
PANELS = ((0.01, 0.15), (0.185, 0.155), (0.45, 0.125), (0.6, 0.2), (0.835, 0.155))
ARROWS = (0.17, 0.365, 0.6, 0.8)


def main(plan_folder: Path, run_folder: Path, out: Path) -> None:
    """Draw five panels side by side, with what leads from each to the next."""
    plan = json.loads((plan_folder / "plan.json").read_text(encoding="utf-8"))
    world = json.loads((plan_folder / "world.json").read_text(encoding="utf-8"))
    figure = plt.figure(figsize=(15, 3.6))
    axes = []
    for (left, width), title in zip(PANELS, TITLES, strict=True):
        axis = figure.add_axes((left, 0.17, width, 0.64))
        axes.append(axis)
        figure.text(left + width / 2, 0.9, title, ha="center", fontsize=13,
                    fontweight="bold")  # fmt: skip
    for x in ARROWS:
        figure.text(x, 0.9, "\u2192", ha="center", fontsize=16, color=GREY)
    drawing(axes[0], world)
    predicted(axes[1], plan, plan_folder)
    focus(axes[2], plan)
    steps(axes[3], plan)
    run(axes[4], run_folder)
    figure.savefig(out, dpi=90)


def drawing(axis: Axes, world: Any) -> None:
    """Draw the gear's outline."""
    (gear,) = [part for part in world["parts"] if part["name"] == "gear"]
    for ring in gear["outline"]["rings"]:
        points = np.vstack([_points(edge) for edge in ring["edges"]])
        axis.plot(*points.T, color=BLUE, linewidth=1.2)
    axis.set_aspect("equal")
    axis.axis("off")
    axis.text(0.5, -0.05, "gear18.dxf, 100 um", transform=axis.transAxes, ha="center",
              va="top", fontsize=10, color=GREY)  # fmt: skip


def _points(edge: list[float]) -> np.ndarray:
    """Return points along a segment or an arc."""
    if len(edge) == 4:
        return np.array([edge[:2], edge[2:]])
    x, y, radius, start, sweep = edge
    count = max(2, math.ceil(abs(sweep) / FINEST_RAD))
    angle = start + sweep * np.linspace(0, 1, count)
    return np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle)))


def predicted(axis: Axes, plan: Any, folder: Path) -> None:
    """Show a look's reference image and where its feature should be."""
    look = plan["steps"][0]["looks"][0]
    image = mpimg.imread(folder / look["scene"]["image"])
    axis.imshow(image, cmap="gray", vmin=0, vmax=image.max())
    measure = look["measure"]
    at, region = measure["reference"], measure["region"]
    shown = image.shape[:2]
    whole = shown != (region["rows"], region["columns"])
    column = at["column"] + region["column"] * whole
    row = at["row"] + region["row"] * whole
    teeth = plt.Circle(
        (column, row), 50 / look["view"]["um_per_px"], fill=False, color=ORANGE, lw=1.5
    )
    axis.add_patch(teeth)
    axis.plot([column], [row], "+", color=ORANGE, markersize=10)
    half = 75 / look["view"]["um_per_px"]
    axis.set_xlim(column - half, column + half)
    axis.set_ylim(row + half, row - half)
    axis.axis("off")
    chain = " > ".join(use["id"] for use in measure["chain"])
    text = f"{look['target']} by {chain}"
    axis.text(0.5, -0.05, text, transform=axis.transAxes, ha="center", va="top",
              fontsize=10, color=ORANGE)  # fmt: skip


def focus(axis: Axes, plan: Any) -> None:
    """Show over which focus errors every look meets its tolerance."""
    looks = [look for step in plan["steps"] for look in step["looks"]]
    for number, look in enumerate(looks):
        low, high = look["measure"]["usable_focus_um"]
        axis.barh(-number, high - low, left=low, color=BLUE, height=0.6)
    axis.set_yticks([-n for n in range(len(looks))], [look["id"] for look in looks])
    axis.tick_params(labelsize=9)
    axis.axvline(0, color=GREY, linewidth=0.8)
    axis.set_xlabel("um, tried to 40", fontsize=10)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def steps(axis: Axes, plan: Any) -> None:
    """List the steps with what they promise."""
    lines = []
    for step in plan["steps"]:
        looks = step["looks"]
        sigma = (look["together"] or look["measure"] for look in looks)
        told = [f"sigma {found['sigma_xy_um']:.2g} um" for found in sigma]
        if step["verb"] == "insert":
            told = [f"P {step['budget']['success_probability']:.4f}"]
        lines.append(f"{step['id']:<16}{told[0] if told else ''}")
    lines += ["", f"{plan['status']}, P(success) {plan['success_probability']:.4f}"]
    axis.axis("off")
    axis.text(0.08, 1.0, "\n".join(lines), family="monospace", fontsize=9, va="top",
              transform=axis.transAxes)  # fmt: skip


def run(axis: Axes, folder: Path) -> None:
    """Show the frame that verifies, and what the cell says of it."""
    frames = sorted((folder / "frames").glob("*check_seated*.png"))
    whole = [frame for frame in frames if not frame.stem.endswith("_region")]
    image = mpimg.imread(whole[0])
    rows, columns = image.shape[:2]
    half = 85
    axis.imshow(image, cmap="gray", vmin=0, vmax=image.max())
    axis.set_xlim(columns / 2 - half, columns / 2 + half)
    axis.set_ylim(rows / 2 + half, rows / 2 - half)
    axis.axis("off")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    truth = summary["cell_verdict"]
    seated = "seated" if truth["success"] else "not seated"
    text = f"simulated: {seated}, truly {truth['offset_um']:.2f} um off"
    axis.text(0.5, -0.05, text, transform=axis.transAxes, ha="center", va="top",
              fontsize=10, color=GREY)  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("plan", "run", "picture"):
        parser.add_argument(name, type=Path)
    call = parser.parse_args()
    main(call.plan, call.run, call.picture)
