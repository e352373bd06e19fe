"""Inverse transforms of coefficients, pruned to the pixels seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import fft

# one precision in, the same out
Coefficients = npt.NDArray[np.complex64] | npt.NDArray[np.complex128]
Samples = npt.NDArray[np.float32] | npt.NDArray[np.float64]
Factors = tuple[Samples, Samples]  # (R, n), (n, C) of a sum of products

_BLOCK = 1 << 18  # bytes of rows transformed at once: they stay in the cache


@dataclass(frozen=True, slots=True)
class Space:
    """Arrays that are used again; a new one's pages cost as much as its transform.

    What is taken under one name is lost when that name is taken again.
    """

    _held: dict[str, npt.NDArray[np.generic]] = field(default_factory=dict)

    def take(
        self, name: str, like: Coefficients, shape: tuple[int, int]
    ) -> Coefficients:
        """Return an array of a shape with any content, in the precision of `like`."""
        held = self._held.get(name)
        if held is None or held.shape != shape or held.dtype != like.dtype:
            held = np.empty(shape, dtype=like.dtype)
            self._held[name] = held
        return held  # type: ignore[return-value]  # its dtype is that of `like`


def fast_length(least: float) -> int:
    """Return the next length whose real transform is fast."""
    size = fft.next_fast_len(math.ceil(least), real=True)
    if size is None:  # only if the length overflowed
        raise ValueError(f"no transform of length {least}")
    return size


def waves_at(
    values: Coefficients, y: npt.NDArray[np.float64], x: npt.NDArray[np.float64]
) -> Samples:
    """Return the sum of the waves at any points.

    Parameters
    ----------
    values : (2 K + 1, J + 1) complex array
        Coefficients as in `microplan.optics.render.spectrum.Spectrum`.
    y, x : (R,), (C,) float64 arrays
        Heights from the bottom and distances from the left, in tiles.

    Returns
    -------
    (R, C) float array
        In the precision of `values`.
    """
    K, J = values.shape[0] // 2, values.shape[1] - 1
    kind = values.real.dtype
    cosines, sines = _turned(y, K, kind)
    up, down = values[1 : K + 1], values[:K:-1]
    # orders k and -k share their cosine, and their sines but for the sign
    even = np.ascontiguousarray(np.concatenate([values[:1], up + down])).view(kind)
    odd = np.ascontiguousarray(up - down).view(kind)
    lines, crossed = cosines @ even, sines[:, 1:] @ odd
    real, imag = lines[:, ::2] - crossed[:, 1::2], lines[:, 1::2] + crossed[:, ::2]
    real[:, 1:] *= 2  # the other half of the spectrum is the conjugate
    imag[:, 1:] *= 2
    cosines, sines = _turned(x, J, kind)
    image: Samples = real @ cosines.T - imag @ sines.T
    return image


def _turned(
    places: npt.NDArray[np.float64],
    highest: int,
    kind: np.dtype[np.float32] | np.dtype[np.float64],
) -> tuple[Samples, Samples]:
    """Return cosines and sines (N, highest + 1) of all orders at points, in tiles.

    Turns are counted in doubles, so that a single one keeps its 1e-7 at any order.
    """
    turns = places[:, None] * np.arange(highest + 1)
    turns -= np.rint(turns)
    angle = (2 * np.pi * turns).astype(kind)
    return np.cos(angle), np.sin(angle)


def weigh(
    values: Coefficients, gain: Samples, out: Coefficients | None = None
) -> Coefficients:
    """Return coefficients times an even gain, cut to the gain's orders.

    Parameters
    ----------
    values : (2 K + 1, J + 1) complex array
        Coefficients as in `microplan.optics.render.spectrum.Spectrum`.
    gain : (k + 1, j + 1) float array
        For orders 0..k <= K and 0..j <= J.
    out : (N >= 2 k + 1, j + 1) complex array, optional
        Where to put orders 0..k first, -k..-1 last, and zeros between.

    Returns
    -------
    (N, j + 1) complex array
        `out`, or a new one of 2 k + 1 rows in the precision of `values`.
    """
    k, columns = gain.shape[0] - 1, gain.shape[1]
    if out is None:
        out = np.empty((2 * k + 1, columns), dtype=values.dtype)
    np.multiply(values[: k + 1, :columns], gain, out=out[: k + 1])
    split = out.shape[0] - k
    out[k + 1 : split] = 0
    low = values[values.shape[0] - k :, :columns]
    np.multiply(low, gain[:0:-1], out=out[split:])
    return out


def fold(
    values: Coefficients,
    gain: Samples,
    shape: tuple[int, int],
    rows: range,
    columns: range,
    *,
    extra: Factors | None = None,
    space: Space | None = None,
) -> Samples:
    """Return samples of one period, (len(rows), len(columns)), rows down.

    Parameters
    ----------
    values : (2 K + 1, J + 1) complex array
        Coefficients as in `microplan.optics.render.spectrum.Spectrum`; frequencies
        beyond half a cycle a sample fold.
    gain : (k + 1, j + 1) float array
        An even gain by which they are multiplied and to whose orders they are cut.
    shape : (R, C)
        Samples in a period, from the lower left corner.
    rows, columns : range
        Those wanted, of 0..R - 1 upwards and of 0..C - 1.
    extra : ((len(rows), n), (n, len(columns))) float arrays, optional
        Factors of what is added to the samples, in their precision.
    space : Space, optional
        Where the work is done; the result lies in it.

    Returns
    -------
    (len(rows), len(columns)) float array
        In the precision of `values`, the last row wanted first.

    Notes
    -----
    Only the band's columns are transformed upwards, and only the rows wanted along.
    """
    space = space or Space()
    lines = space.take("lines", values, (shape[0], gain.shape[1]))
    if 2 * gain.shape[0] - 1 <= shape[0]:
        weigh(values, gain, lines)
    else:
        _wrap(lines, weigh(values, gain), gain.shape[0] - 1)
    lines = fft.ifft(lines, axis=0, norm="forward", overwrite_x=True)
    lines = lines[rows.start : rows.stop][::-1]
    wide = space.take("image", values, (len(rows), (len(columns) + 1) // 2))
    image = wide.view(wide.real.dtype)[:, : len(columns)]
    # block by block, so that every step finds its rows in the cache
    step = max(1, _BLOCK // ((shape[1] // 2 + 1) * values.itemsize))
    half = space.take("half", values, (step, shape[1] // 2 + 1))
    for begin in range(0, len(rows), step):
        part = slice(begin, begin + step)
        block = half[: min(step, len(rows) - begin)]
        _fill_half(block, lines[part], shape[1])
        full = fft.irfft(block, n=shape[1], axis=1, norm="forward", overwrite_x=True)
        seen = full[:, columns.start : columns.stop]
        if extra is None:
            image[part] = seen
        else:
            np.add(seen, extra[0][part] @ extra[1], out=image[part])
    return image


def _wrap(lines: Coefficients, values: Coefficients, K: int) -> None:
    """Fill `lines` with orders 0..K, -K..-1 folded to as many as there are lines."""
    lines[...] = 0
    for start, first, count in ((0, 0, K + 1), (-K, K + 1, K)):
        for to, done, step in _laps(start, count, lines.shape[0]):
            part = values[first + done : first + done + step]
            lines[to : to + step] += part


def _fill_half(half: Coefficients, lines: Coefficients, columns: int) -> None:
    """Fill `half` with orders 0..J of `lines`, folded to those of `columns` samples."""
    J, straight = lines.shape[1] - 1, (columns - 1) // 2
    direct = min(J, straight)
    half[:, : direct + 1] = lines[:, : direct + 1]
    half[:, direct + 1 :] = 0
    # period by period: orders past its middle fall as their mirror images, then the
    # next period's rise
    for start in range(0, J + 1, columns):
        if start:
            half[:, 0] += 2 * lines[:, start].real  # and its conjugate
            last = min(J, start + straight)
            half[:, 1 : last - start + 1] += lines[:, start + 1 : last + 1]
        if columns % 2 == 0 and start + columns // 2 <= J:
            half[:, -1] += 2 * lines[:, start + columns // 2].real
        begin, end = start + columns // 2 + 1, min(J, start + columns - 1)
        if begin <= end:
            count, top = end - begin + 1, columns - (begin - start)
            fallen = half[:, top - count + 1 : top + 1]
            fallen += np.conj(lines[:, begin : end + 1])[:, ::-1]


def _laps(start: int, count: int, period: int) -> Iterator[tuple[int, int, int]]:
    """Cut `count` orders from `start` on where they wrap; yield to, first, count."""
    done = 0
    while done < count:
        place = (start + done) % period
        step = min(period - place, count - done)
        yield place, done, step
        done += step
