"""The loop over rays of all points: sums of what they see past several faces.

Compiled: a run of points stays in the processor's nearest memory for all its rays.
"""

from __future__ import annotations

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.compiled import compiled

_RUN = 128  # points of a row that are summed together
_BUNDLE = 16  # rays whose sum is in single precision
# columns of what is known of each field: where it begins, its columns (0: one value
# for all rays), and which place rays meet it at
_FIRST, _COLUMNS, _PLACE = range(3)
# columns of what is known of each face: its fields, and how many images follow UNLIT
_IS_SHARP, _SENDS_ALL, _OF_COVERED, _FREE, _SENDS, _LIGHT, _UNLIT, _IMAGES = range(8)


@compiled
def ray_sums(
    values: Float32Array,
    fields: IntArray,
    down: FloatArray,
    right: FloatArray,
    is_between: BoolArray,
    faces: IntArray,
    finish: Float32Array,
    sums: FloatArray,
) -> None:
    """Add up what rays from points see of faces, and meet of each field.

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
    sums : (S + F, rows, columns) float64 array, out
        Of what is seen: below all that is sharp, of each sharp face, above; then of
        the fields.
    """
    seen, rays = sums.shape[0] - fields.shape[0], down.shape[1]
    runs = -(-sums.shape[2] // _RUN)
    run = -(-sums.shape[2] // runs)  # none of them short
    met = np.empty((fields.shape[0], _RUN), dtype=np.float32)
    view = np.empty((seen + 3, _RUN), dtype=np.float32)
    total = np.empty((sums.shape[0], _RUN), dtype=np.float32)
    _spread(values, fields, met)
    sums[:, :, :] = 0.0
    for row in range(sums.shape[1]):
        for left in range(0, sums.shape[2], run):
            n = min(run, sums.shape[2] - left)
            for first in range(0, rays, _BUNDLE):
                total[:, :] = np.float32(0.0)
                for r in range(first, min(first + _BUNDLE, rays)):
                    places = down, right, is_between
                    _meet(values, fields, places, (r, row, left, n), met, total)
                    _compose(met, faces, finish, n, view)
                    for s in range(seen):
                        for i in range(n):
                            total[s, i] += view[s, i]
                for s in range(sums.shape[0]):
                    for i in range(n):
                        sums[s, row, left + i] += total[s, i]
    for f in range(fields.shape[0]):
        if fields[f, _COLUMNS] == 0:
            sums[seen + f, :, :] = float(rays) * values[fields[f, _FIRST]]


@compiled
def _spread(values: Float32Array, fields: IntArray, met: Float32Array) -> None:
    """Write fields that are one value to all points of a run, in place."""
    for f in range(fields.shape[0]):
        if fields[f, _COLUMNS] == 0:
            met[f, :] = values[fields[f, _FIRST]]


@compiled
def _meet(
    values: Float32Array,
    fields: IntArray,
    places: tuple[FloatArray, FloatArray, BoolArray],
    at: tuple[int, int, int, int],
    met: Float32Array,
    total: Float32Array,
) -> None:
    """Read a run of all fields that are not even where a ray meets them, in place."""
    down, right, is_between = places
    r, row, left, n = at
    for f in range(fields.shape[0]):
        if fields[f, _COLUMNS] > 0:
            k = fields[f, _PLACE]
            y, x = row + down[k, r], left + right[k, r]
            if is_between[k]:
                _read_between(values, fields, f, y, x, n, met, total)
            else:
                _read(values, fields, f, y, x, n, met, total)


@compiled
def _read(
    values: Float32Array,
    fields: IntArray,
    f: int,
    y: float,
    x: float,
    n: int,
    met: Float32Array,
    total: Float32Array,
) -> None:
    """Read a run of a field from a row and column on, and add it up, in place."""
    at = fields[f, _FIRST] + int(y) * fields[f, _COLUMNS] + int(x)
    run, row = values[at : at + n], total.shape[0] - fields.shape[0] + f
    for i in range(n):
        met[f, i] = run[i]
        total[row, i] += run[i]


@compiled
def _read_between(
    values: Float32Array,
    fields: IntArray,
    f: int,
    y: float,
    x: float,
    n: int,
    met: Float32Array,
    total: Float32Array,
) -> None:
    """Read the same linear between a field's points."""
    out = total.shape[0] - fields.shape[0] + f
    row, column, columns = int(y), int(x), fields[f, _COLUMNS]
    v, u = np.float32(y - row), np.float32(x - column)
    at = fields[f, _FIRST] + row * columns + column
    high = values[at : at + n + 1]
    low = values[at + columns : at + columns + n + 1]
    for i in range(n):
        upper = high[i] + u * (high[i + 1] - high[i])
        lower = low[i] + u * (low[i + 1] - low[i])
        between = upper + v * (lower - upper)
        met[f, i] = between
        total[out, i] += between


@compiled
def _compose(
    met: Float32Array, faces: IntArray, finish: Float32Array, n: int, view: Float32Array
) -> None:
    """Lay faces over each other for a run of points, the lowest first, in place.

    As `microplan.optics.layers.joint.joint_faces.composite` does means. The last rows
    of `view` are what lies above the last sharp face, what a face sends, and mirrors.
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
