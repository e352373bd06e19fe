"""The loop over rays of all points: what they see past several faces in the mean.

Compiled: a block of points stays in the processor's nearest memory for all its rays.
Loops over it are long, and of whole vectors: what is left over would take longer.
"""

from __future__ import annotations

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.compiled import compiled

_BLOCK = 384  # points that are summed together, of some rows
_RUN = 48  # of them in a row where not all points are wanted
_LANES = 8  # points of a row that are one vector
_VECTOR = 32  # points of a block that are one step of its loops
_BUNDLE = 16  # rays whose sum is in single precision
# columns of what is known of each field: where it begins, its columns (0: one value
# for all rays), and which place rays meet it at
_FIRST, _COLUMNS, _PLACE = range(3)
# columns of what is known of each face: its fields, and how many images follow UNLIT
_IS_SHARP, _SENDS_ALL, _OF_COVERED, _FREE, _SENDS, _LIGHT, _UNLIT, _IMAGES = range(8)


@compiled
def residuals(
    values: Float32Array,
    fields: IntArray,
    down: FloatArray,
    right: FloatArray,
    is_between: BoolArray,
    faces: IntArray,
    finish: Float32Array,
    wanted: BoolArray,
    found: FloatArray,
) -> None:
    """Find what rays from points see of faces in the mean, less what means of each do.

    Parameters
    ----------
    values : (M,) float32 array
        All fields one after the other, rows down, shares of full scale.
    fields : (F, 3) int array
        Where each begins, its columns, its place.
    down, right : (K, R) float64 array
        Row and column of each place's fields that each ray from the first point meets.
    is_between : (K,) bool array
        Whether these are no whole numbers.
    faces : (P, 8) int array
        Of each, the lowest first: whether it is sharp, sends have all light in them,
        they are of what is covered; fields of what it leaves free, sends, of its light,
        sends unlit (those of images follow); how many images, -1 for no mirror.
    finish : (P,) float32 array
        Share of a mirror.
    wanted : (rows, columns) bool array
        Points; at others that lie in no block with them it is 0. Empty: all.
    found : (S, rows, columns) float64 array, out
        Of what is seen: below all that is sharp, of each sharp face, above.
    """
    seen, rows, columns = found.shape
    run = _BLOCK if wanted.size == 0 else _RUN
    parts = -(-columns // run)
    wide = -(-columns // (parts * _LANES)) * _LANES
    high = max(_BLOCK // wide, 1)
    size = -(-wide * high // _VECTOR) * _VECTOR
    met = np.zeros((fields.shape[0], size), dtype=np.float32)
    view = np.zeros((seen + 3, size), dtype=np.float32)
    total = np.empty((seen + fields.shape[0], size))
    # what is read of the last points, and not used
    values = np.concatenate((values, np.zeros(_LANES + 1, dtype=np.float32)))
    _spread(values, fields, met)
    places = down, right, is_between
    for top in range(0, rows, high):
        count = min(high, rows - top)
        for left in range(0, columns, wide):
            n = min(wide, -(-(columns - left) // _LANES) * _LANES)
            last = min(left + n, columns)
            if wanted.size > 0 and not wanted[top : top + count, left:last].any():
                found[:, top : top + count, left:last] = 0.0
                continue
            block = top, count, left, n
            _add_up(values, fields, places, faces, finish, block, met, view, total)
            _compose_means(fields, faces, finish, down.shape[1], met, view, total)
            for s in range(seen):
                for k in range(count):
                    for i in range(last - left):
                        at = k * n + i
                        found[s, top + k, left + i] = total[s, at] - view[s, at]


@compiled
def _compose_means(
    fields: IntArray,
    faces: IntArray,
    finish: Float32Array,
    rays: int,
    met: Float32Array,
    view: Float32Array,
    total: FloatArray,
) -> None:
    """Make sums of a block means, and lay those of fields over each other, in place."""
    seen, n = total.shape[0] - fields.shape[0], met.shape[1]
    for s in range(total.shape[0]):
        for i in range(n):
            total[s, i] /= rays
    for f in range(fields.shape[0]):
        if fields[f, _COLUMNS] > 0:
            for i in range(n):
                met[f, i] = total[seen + f, i]
    _compose(met, faces, finish, n, view)


@compiled
def _spread(values: Float32Array, fields: IntArray, met: Float32Array) -> None:
    """Write fields that are one value to all points of a block, in place."""
    for f in range(fields.shape[0]):
        if fields[f, _COLUMNS] == 0:
            met[f, :] = values[fields[f, _FIRST]]


@compiled
def _add_up(
    values: Float32Array,
    fields: IntArray,
    places: tuple[FloatArray, FloatArray, BoolArray],
    faces: IntArray,
    finish: Float32Array,
    block: tuple[int, int, int, int],
    met: Float32Array,
    view: Float32Array,
    total: FloatArray,
) -> None:
    """Write the sums of a block's points: first row, rows, first column, columns."""
    rays, seen = places[0].shape[1], total.shape[0] - fields.shape[0]
    size = -(-block[1] * block[3] // _VECTOR) * _VECTOR
    bundle = np.empty(total.shape, dtype=np.float32)
    total[:, :] = 0.0
    for first in range(0, rays, _BUNDLE):
        bundle[:, :] = np.float32(0.0)
        for r in range(first, min(first + _BUNDLE, rays)):
            _meet(values, fields, places, r, block, met)
            _compose(met, faces, finish, size, view)
            for s in range(seen):
                _add(view, s, size, bundle, s)
            for f in range(fields.shape[0]):
                if fields[f, _COLUMNS] > 0:
                    _add(met, f, size, bundle, seen + f)
        for s in range(total.shape[0]):
            for i in range(size):
                total[s, i] += bundle[s, i]


@compiled
def _add(values: Float32Array, row: int, n: int, found: Float32Array, to: int) -> None:
    """Add a row to one of another array, in place."""
    for i in range(n):
        found[to, i] += values[row, i]


@compiled
def _meet(
    values: Float32Array,
    fields: IntArray,
    places: tuple[FloatArray, FloatArray, BoolArray],
    r: int,
    block: tuple[int, int, int, int],
    met: Float32Array,
) -> None:
    """Read all fields that are not even where a ray meets them, in place."""
    down, right, is_between = places
    top, count, left, n = block
    for f in range(fields.shape[0]):
        columns = fields[f, _COLUMNS]
        if columns == 0:
            continue
        place = fields[f, _PLACE]
        y, x = top + down[place, r], left + right[place, r]
        row, column = int(y), int(x)
        at = fields[f, _FIRST] + row * columns + column
        v, u = np.float32(y - row), np.float32(x - column)
        for k in range(count):
            if is_between[place]:
                _read_between(values, at, columns, (u, v), n, met, f, k * n)
            else:
                _read(values, at, n, met, f, k * n)
            at += columns


@compiled
def _read(
    values: Float32Array, at: int, n: int, met: Float32Array, f: int, first: int
) -> None:
    """Read a run of values, in place."""
    run, out = values[at : at + n], met[f, first : first + n]
    for i in range(n):
        out[i] = run[i]


@compiled
def _read_between(
    values: Float32Array,
    at: int,
    columns: int,
    share: tuple[np.float32, np.float32],
    n: int,
    met: Float32Array,
    f: int,
    first: int,
) -> None:
    """Read the same linear between points, shares of a step on, in place."""
    u, v = share
    high = values[at : at + n + 1]
    low = values[at + columns : at + columns + n + 1]
    out = met[f, first : first + n]
    for i in range(n):
        upper = high[i] + u * (high[i + 1] - high[i])
        lower = low[i] + u * (low[i + 1] - low[i])
        out[i] = upper + v * (lower - upper)


@compiled
def _compose(
    met: Float32Array, faces: IntArray, finish: Float32Array, n: int, view: Float32Array
) -> None:
    """Lay faces over each other for a block of points, the lowest first, in place.

    The last rows of `view` are what lies above the last sharp face, what a face sends,
    and mirrors.
    """
    count, last, sent = 0, view.shape[0] - 3, view.shape[0] - 2
    _fill(view, last, n)
    for k in range(faces.shape[0]):
        light = faces[k, _LIGHT]
        if faces[k, _IS_SHARP] == 1:
            if count == 0:
                _copy(view, last, n, view, 0)
                count = 1
            _copy(met, light, n, view, count)
            _mirror(met, faces, k, 1, finish[k], n, view, count)
            count += 1
            _fill(view, last, n)
            continue
        free = faces[k, _FREE]
        for s in range(count):
            for i in range(n):
                view[s, i] *= met[free, i]
        _copy(met, faces[k, _SENDS], n, view, sent)
        if faces[k, _SENDS_ALL] == 0:
            for i in range(n):
                view[sent, i] *= met[light, i]
        _mirror(met, faces, k, 0, finish[k], n, view, sent)
        if faces[k, _OF_COVERED] == 1:
            for i in range(n):
                view[last, i] -= view[sent, i]
        for i in range(n):
            view[last, i] = view[last, i] * met[free, i] + view[sent, i]
    if count == 0:
        _copy(view, last, n, view, 0)
        count = 1
        _fill(view, last, n)
    _copy(view, last, n, view, count)


@compiled
def _fill(view: Float32Array, row: int, n: int) -> None:
    """Make a row 0."""
    for i in range(n):
        view[row, i] = np.float32(0.0)


@compiled
def _copy(values: Float32Array, row: int, n: int, found: Float32Array, to: int) -> None:
    """Copy a row."""
    for i in range(n):
        found[to, i] = values[row, i]


@compiled
def _mirror(
    met: Float32Array,
    faces: IntArray,
    k: int,
    first: int,
    share: np.float32,
    n: int,
    view: Float32Array,
    row: int,
) -> None:
    """Make a share of what a face gives back a mirror's, in place.

    The product of what images leave, and of what it sends unlit from `first` 0 on.
    """
    if faces[k, _IMAGES] < 0:
        return
    rest, product = np.float32(1.0) - share, view.shape[0] - 1
    for i in range(n):
        view[product, i] = share
    for image in range(first, faces[k, _IMAGES] + 1):
        f = faces[k, _UNLIT] + image
        for i in range(n):
            view[product, i] *= met[f, i]
    for i in range(n):
        view[row, i] = rest * view[row, i] + view[product, i]
