"""Error maps as pictures and as tables of numbers, for people."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from microplan.arrays import FloatArray

_SMALLEST = 1e-5  # half of what the tables may err by; darker is less
_DOTS_PER_INCH = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """The two axes of all maps of one picture, with the names they have in a table."""

    down: FloatArray  # (rows,)
    down_name: str
    right: FloatArray  # (columns,)
    right_name: str


def save_csv(path: Path, grid: Grid, maps: Mapping[str, FloatArray]) -> None:
    """Write maps (rows, columns) as columns of a table, a line per place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([grid.down_name, grid.right_name, *maps])
        for i, down in enumerate(grid.down):
            for j, right in enumerate(grid.right):
                cells = [down, right, *(values[i, j] for values in maps.values())]
                writer.writerow([f"{cell:.6g}" for cell in cells])


def draw_laws(
    path: Path,
    grid: Grid,
    laws: Sequence[str],
    kinds: Sequence[str],
    maps: Mapping[str, FloatArray],
) -> None:
    """Draw a row per law: errors by kind, and the worst shape over the prediction.

    `maps` holds "law.kind", and "law.share" for the last column.
    """
    mpl.use("Agg")
    figure, panels = plt.subplots(
        len(laws),
        len(kinds) + 1,
        figsize=(17, 10),
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for row, law in zip(panels, laws, strict=True):
        for panel, kind in zip(row, (*kinds, "share"), strict=True):
            scale = Normalize(0, 1) if kind == "share" else LogNorm(_SMALLEST, 1)
            colours = "cividis" if kind == "share" else "viridis"
            values = np.maximum(maps[f"{law}.{kind}"], 1e-9)
            panel.pcolormesh(grid.right, grid.down, values, norm=scale, cmap=colours)
            panel.set_yscale("log")
        row[0].set_ylabel(f"{law}\nW20, waves")
    for panel, kind in zip(panels[0], (*kinds, "worst / predicted"), strict=True):
        panel.set_title(kind)
    for panel in panels[-1]:
        panel.set_xlabel("A / n")
    figure.suptitle("Error of defocus laws against the exact phase")
    _bar(
        figure,
        panels[:, :-1],
        LogNorm(_SMALLEST, 1),
        "error, of unit contrast",
        low=True,
    )
    _bar(
        figure,
        panels[:, -1],
        Normalize(0, 1),
        "share of the prediction",
        colours="cividis",
    )
    figure.savefig(path, dpi=_DOTS_PER_INCH)
    plt.close(figure)


def draw_tables(
    path: Path, grid: Grid, maps: Mapping[str, FloatArray], stated: float
) -> None:
    """Draw a map per model: its table's error as a share of what is stated."""
    mpl.use("Agg")
    figure, panels = plt.subplots(
        1, len(maps), figsize=(17, 5), sharey=True, layout="constrained"
    )
    for panel, (model, values) in zip(panels, maps.items(), strict=True):
        shares = np.maximum(values / stated, 1e-9)
        panel.pcolormesh(shares, norm=LogNorm(1e-4, 1))
        panel.set(title=model, xlabel="A / n")
        _name(panel, grid)
    panels[0].set_ylabel("defocus, um")
    figure.suptitle(f"Error of the tables of transfers, as a share of {stated:g}")
    _bar(figure, panels, LogNorm(1e-4, 1), f"share of {stated:g}", low=True)
    figure.savefig(path, dpi=_DOTS_PER_INCH)
    plt.close(figure)


def _name(panel: Axes, grid: Grid) -> None:
    """Write the values of both axes at the middles of cells."""
    panel.set_xticks(
        np.arange(grid.right.size) + 0.5, [f"{a:g}" for a in grid.right], rotation=90
    )
    panel.set_yticks(np.arange(grid.down.size) + 0.5, [f"{z:g}" for z in grid.down])


def _bar(
    figure: Figure,
    panels: npt.NDArray[np.object_],
    scale: Normalize,
    label: str,
    *,
    colours: str = "viridis",
    low: bool = False,
) -> None:
    """Put a colour bar beside panels; `low` for a scale that values fall below."""
    figure.colorbar(
        ScalarMappable(norm=scale, cmap=colours),
        ax=panels,
        label=label,
        aspect=50,
        extend="min" if low else "neither",
    )
