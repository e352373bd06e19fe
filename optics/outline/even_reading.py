"""Values of a grid at the points of a lattice that lies turned on it."""

from __future__ import annotations

from microplan.arrays import Float32Array, Point
from microplan.compiled import compiled


@compiled
def read_even(
    values: Float32Array,
    grid_um: float,
    turn: Point,
    first_um: Point,
    step_um: float,
    found: Float32Array,
) -> None:
    """Write values, linear between the points of a grid, at those of a lattice.

    Smoothly as the lattice moves by any little. Beyond the grid they are those at its
    rim.

    Parameters
    ----------
    values : (rows, columns) array
        Of the grid, y upwards, `grid_um` apart.
    turn : (cosine, sine)
        Of the grid's frame in the lattice's.
    first_um : (u, v)
        The lattice's first point from the grid's first one, in the grid's frame.
    step_um : float
        Of the lattice, whose rows run down.
    found : (rows, columns) array
        Takes them.
    """
    last_row, last_column = values.shape[0] - 1, values.shape[1] - 1
    along, aside = turn[0] * step_um / grid_um, turn[1] * step_um / grid_um
    for row in range(found.shape[0]):
        for column in range(found.shape[1]):
            u = first_um[0] / grid_um + column * along - row * aside
            v = first_um[1] / grid_um - column * aside - row * along
            u = min(max(u, 0.0), float(last_column))
            v = min(max(v, 0.0), float(last_row))
            left, low = min(int(u), last_column - 1), min(int(v), last_row - 1)
            u, v = u - left, v - low
            below = values[low, left] * (1 - u) + values[low, left + 1] * u
            above = values[low + 1, left] * (1 - u) + values[low + 1, left + 1] * u
            found[row, column] = below * (1 - v) + above * v
