"""Make the pictures and the numbers of optics-tutorial.md: python docs/tutorial.py.

The page shows the paper's figures 6, 7 and 8 (Feddema & Simon, 1998) made anew, and
where the paper's model of the microscope departs from the exact one.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "optics-tutorial.md"
IMAGES = ROOT / "docs" / "images"
BEGIN, END = "<!-- numbers: begin -->", "<!-- numbers: end -->"
PAPER = Microscope(
    aperture=0.42,
    wavelength_um=0.6,
    medium_index=1.0,
    magnification=44.5,
    pitch_um=7.5,
    width_px=640,
    height_px=480,
)
OUT_UM = 25.0  # of focus, as in the paper's figure 8
NEAR_UM = (0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0)
MODELS = ("geometric", "product", "stokseth", "hopkins")
# a strip over bore, rim and teeth on the right; the gear is larger than the frame
STRIP = Window(row=238, column=410, rows=4, columns=280)
_CURVES = {
    "the paper: product, n = 1.5": ("tab:red", "--"),
    "product, n = 1": ("tab:orange", "-"),
    "exact, n = 1": ("black", "-"),
}


def gear() -> Outline:
    """Return the example's gear, as drawn."""
    report = Report()
    task = load_task(str(ROOT / "examples" / "gear_on_shaft" / "task.yaml"), report)
    if task is None:
        raise RuntimeError(f"the example does not load: {report.found}")
    return task.parts["gear"].outline


def image(
    part: Outline, optics: Microscope, z_um: float, model: str, window: Window | None
) -> FloatArray:
    """Return a white part over black, `z_um` above the plane in focus."""
    layer = Layer(name="gear", outline=part, z_um=z_um, reflectance=1.0)
    scene = Scene(layers=(layer,), background=0.0)
    return render(scene, optics, focus_um=0.0, model=model, window=window)


def errors(part: Outline) -> dict[str, list[float]]:
    """Return each model's largest difference from the exact one, by `NEAR_UM`."""
    window = Window(row=140, column=420, rows=200, columns=200)
    found: dict[str, list[float]] = {model: [] for model in (*MODELS, "none")}
    focused = image(part, PAPER, 0.0, "exact", window)
    for z_um in NEAR_UM:
        truth = image(part, PAPER, z_um, "exact", window)
        for model in MODELS:
            other = image(part, PAPER, z_um, model, window)
            found[model].append(float(np.abs(other - truth).max()))
        found["none"].append(float(np.abs(focused - truth).max()))
    return found


def table(part: Outline) -> str:
    """Return the errors as a Markdown table."""
    heads = ["model", *(f"z = {z:g} um" for z in NEAR_UM)]
    rows = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    names = {"none": "defocus ignored", "product": "`product` (the paper)"}
    for model, values in errors(part).items():
        cells = [names.get(model, f"`{model}`"), *(f"{v:.1g}" for v in values)]
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def with_table(text: str, part: Outline) -> str:
    """Return the page with what stands between the marks replaced by the table."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{table(part)}\n\n{END}{after}"


def _profiles(part: Outline, z_um: float) -> dict[str, FloatArray]:
    """Return cross-sections by the names of `_CURVES`."""
    paper = replace(PAPER, medium_index=1.5)
    settings = ((paper, "product"), (PAPER, "product"), (PAPER, "exact"))
    return {
        name: image(part, optics, z_um, model, STRIP)[2]
        for name, (optics, model) in zip(_CURVES, settings, strict=True)
    }


def _section(axes: Axes, part: Outline, z_um: float) -> None:
    """Draw cross-sections along the x axis."""
    columns = np.arange(STRIP.columns) + STRIP.column - (PAPER.width_px - 1) / 2
    for name, values in _profiles(part, z_um).items():
        color, dash = _CURVES[name]
        axes.plot(columns * PAPER.um_per_px, values, dash, color=color, label=name)
    axes.set_xlabel("x [um]")
    axes.set_ylabel("intensity")
    axes.set_ylim(-0.05, 1.65)
    axes.legend(loc="upper right")


def _departure(axes: Axes, part: Outline, z_um: float) -> None:
    """Draw how far cross-sections are from the exact one."""
    columns = np.arange(STRIP.columns) + STRIP.column - (PAPER.width_px - 1) / 2
    profiles = _profiles(part, z_um)
    truth = profiles["exact, n = 1"]
    for name, values in profiles.items():
        color, dash = _CURVES[name]
        axes.plot(columns * PAPER.um_per_px, values - truth, dash, color=color)
    axes.set_xlabel("x [um]")
    axes.set_ylabel("difference from exact")


def _figure_6(axes: Sequence[Axes], part: Outline) -> None:
    """Draw the gear in focus and out of it, at the lowest zoom."""
    low = replace(PAPER, magnification=6.9)
    window = Window(row=180, column=260, rows=120, columns=120)
    for each, z_um in zip(axes, (0.0, OUT_UM), strict=True):
        shown = image(part, low, z_um, "exact", window)
        each.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        each.set_title(f"{z_um:g} um out of focus" if z_um else "in focus")
        each.set_axis_off()


def _figure_7(axes: Sequence[Axes], part: Outline) -> None:
    """Draw the cross-section in focus."""
    _section(axes[0], part, 0.0)
    axes[0].set_title("in focus: every model is the same")


def _figure_8(axes: Sequence[Axes], part: Outline) -> None:
    """Draw cross-sections out of focus, and below them what is wrong with them."""
    for each, below, z_um in zip(axes[:2], axes[2:], (2.5, OUT_UM), strict=True):
        _section(each, part, z_um)
        each.set_title(f"{z_um:g} um out of focus")
        _departure(below, part, z_um)


def _figure_models(axes: Sequence[Axes], part: Outline) -> None:
    """Draw the models' errors over defocus."""
    for model, values in errors(part).items():
        label = "defocus ignored" if model == "none" else model
        dash = ":" if model == "none" else "-"
        axes[0].loglog(NEAR_UM, values, dash, marker="o", label=label)
    axes[0].set_xlabel("defocus [um]")
    axes[0].set_ylabel("largest image error")
    axes[0].grid(visible=True, which="both", alpha=0.3)
    axes[0].legend()


Drawing = Callable[[Sequence[Axes], Outline], None]
FIGURES: dict[str, tuple[Drawing, tuple[int, int], tuple[float, float]]] = {
    "tutorial-6-gear.png": (_figure_6, (1, 2), (7.0, 4.0)),
    "tutorial-7-in-focus.png": (_figure_7, (1, 1), (7.0, 3.4)),
    "tutorial-8-out-of-focus.png": (_figure_8, (2, 2), (10.0, 6.4)),
    "tutorial-models.png": (_figure_models, (1, 1), (7.0, 4.2)),
}


def main() -> int:
    """Write the pictures and the page; return 0."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    part = gear()
    for name, (draw, shape, size) in FIGURES.items():
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        draw(list(figure.subplots(*shape, squeeze=False).ravel()), part)
        figure.savefig(IMAGES / name, dpi=90, metadata={"Software": None})
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_table(text, part), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
