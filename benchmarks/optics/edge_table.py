"""Makes `optics/coherence/edge_table.py`: straight edges in partly coherent light.

`python -m benchmarks.optics.edge_table` computes it again, in about six minutes of two
cores.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from benchmarks.figures import Options
from microplan.arrays import FloatArray
from microplan.optics.transfer.otf import hopkins
from tests.optics.coherence.coherent_edge import (
    EdgeImage,
    abbe_edge,
    no_phase,
    quadratic,
)

TABLE = Path(__file__).parents[2] / "optics" / "coherence" / "edge_table.py"
COHERENCE = (
    *(0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0),
    *(1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 4.0),
)
WAVES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
CONTRAST = (0.0, 0.25, 0.5, 0.75, 1.0)
_LEAST = 1e-4  # stands for a coherence or contrast of 0
_X: FloatArray = np.linspace(-4, 4, 101)  # six samples a period of the finest wave
_FEW, _MANY = 28, 40  # nodes of the source: the others agree within 1e-4, and from
_MANY_WAVES = 1.5  # here on they take the many

_INDENT = "    "
_HEAD = '''"""Edges in partly coherent light, from `benchmarks.optics.edge_table`."""

from __future__ import annotations

# Axes: condenser over objective aperture, |W20| in waves, 1 - dark / bright amplitude
COHERENCE = (
{coherence}
)  # fmt: skip
WAVES = {waves}
CONTRAST = {contrast}
# A line for each coherence and defocus, the defocus changing fastest. For each contrast
# the shift of the 50 % point into the bright side over the contrast, in wavelength / A,
# and then the largest error of the incoherent image, of the step.
EDGES = (
'''


def incoherent_edge(x: FloatArray, waves: float) -> FloatArray:
    """Return the incoherent image of an edge of unit height, x in wavelength / A."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    f = (1 + nodes) / 2
    wave = np.sin(4 * np.pi * x[:, None] * f) / (np.pi * f)
    image: FloatArray = 0.5 + wave @ (weights / 2 * hopkins(f, waves))
    return image


def edge_row(
    setting: tuple[float, float], contrasts: Sequence[float] = CONTRAST
) -> list[float]:
    """Return a line of the table for a coherence and W20 in waves.

    Raises
    ------
    ValueError
        If the edge passes through its 50 % level more than once.
    """
    coherence, waves = setting
    phase = quadratic(waves) if waves else no_phase
    nodes = _MANY if waves >= _MANY_WAVES else _FEW
    image = abbe_edge(_X, max(coherence, _LEAST), phase, nodes=nodes)
    other = incoherent_edge(_X, waves)
    offsets, errors = [], []
    for contrast in contrasts:
        offset, error = _measured(image, max(contrast, _LEAST), other)
        offsets.append(offset / max(contrast, _LEAST))
        errors.append(error)
    return offsets + errors


def _measured(
    image: EdgeImage, contrast: float, other: FloatArray
) -> tuple[float, float]:
    """Return the shift of the 50 % point and the largest difference, of the step."""
    dark = (1 - contrast) ** 2
    step = (image.intensity(contrast) - dark) / (1 - dark)
    above = step >= 0.5
    crossing = np.flatnonzero(above[1:] != above[:-1])
    if crossing.size != 1:
        raise ValueError(f"the edge passes through 50 % {crossing.size} times")
    i = int(crossing[0])
    spline = CubicSpline(_X, step - 0.5)
    at = brentq(lambda x: float(spline(x)), _X[i], _X[i + 1], xtol=1e-9)
    fine = np.linspace(_X[0], _X[-1], 1601)
    error = np.abs(CubicSpline(_X, step - other)(fine)).max()
    return float(at), float(error)


def write_table(path: Path, jobs: int) -> None:
    """Compute and write the whole table."""
    settings = [(c, w) for c in COHERENCE for w in WAVES]
    with ProcessPoolExecutor(jobs) as pool:
        rows = list(pool.map(edge_row, settings))
    lines = [
        _INDENT + "(" + ", ".join(f"{round(v, 4) + 0.0:.4g}" for v in row) + "),\n"
        for row in rows
    ]
    axis = textwrap.fill(
        ", ".join(map(str, COHERENCE)), 88, initial_indent=_INDENT,
        subsequent_indent=_INDENT,
    )  # fmt: skip
    head = _HEAD.format(coherence=axis, waves=WAVES, contrast=CONTRAST)
    path.write_text(head + "".join(lines) + ")\n", encoding="utf-8")


if __name__ == "__main__":
    write_table(TABLE, Options().jobs)
