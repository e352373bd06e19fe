"""Outcomes of trials as numbers in rows, with statistics of the position errors."""

from __future__ import annotations

import math
import operator
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import overload

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.featuresel.trials.bounds import Estimate, estimate
from microplan.featuresel.trials.calibration import SigmaCalibration, calibrate
from microplan.featuresel.trials.chains import Chain


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceErrors:
    """Errors of the position in the target's frame; None where they are too few."""

    x: Estimate | None = None
    y: Estimate | None = None
    along: Estimate | None = None
    axis_rad: float | None = None
    spread_x: SigmaCalibration | None = None
    spread_y: SigmaCalibration | None = None

    @classmethod
    def of(cls, right: Sequence[Outcome], confidence: float) -> PlaceErrors:
        """Return the statistics of the successes."""
        errors = np.array([o.target_um for o in right if o.target_um is not None])
        spreads = given([o.spread_um for o in right])
        errors = errors.reshape(-1, 2)
        axis = _direction(given([o.axis_rad for o in right]))
        if axis is not None:
            lengths = errors @ np.array([math.cos(axis), math.sin(axis)])
            return cls(
                along=estimate(lengths, confidence),
                axis_rad=axis,
                spread_x=calibrate(lengths, spreads),
            )
        return cls(
            x=estimate(errors[:, 0], confidence),
            y=estimate(errors[:, 1], confidence),
            spread_x=calibrate(errors[:, 0], spreads),
            spread_y=calibrate(errors[:, 1], spreads),
        )

    @property
    def bias_um(self) -> tuple[float, float] | None:
        """Return the mean error in the target's frame."""
        if self.along is not None and self.axis_rad is not None:
            c, s = math.cos(self.axis_rad), math.sin(self.axis_rad)
            return (self.along.mean * c, self.along.mean * s)
        return (self.x.mean, self.y.mean) if self.x and self.y else None

    @property
    def sigma_um(self) -> float | None:
        """Return the spread of the worse axis."""
        sigmas = [a.sigma for a in (self.x, self.y, self.along) if a is not None]
        return max(sigmas, default=None)


def _direction(axes_rad: FloatArray) -> float | None:
    """Return the mean of directions that are the same half a turn on; None of none."""
    if not len(axes_rad):
        return None
    return float(np.angle(np.exp(2j * axes_rad).mean())) / 2


def given(values: Sequence[float | None]) -> FloatArray:
    """Return the (N,) values that are there, in their own unit, e.g. um."""
    return np.array([v for v in values if v is not None], dtype=np.float64)


_AT_ONCE = 1024  # rows that are read as Python's numbers at a time


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one chain said of one trial; errors are measured - true."""

    chain: Chain
    trial: int
    failure: str | None = None  # code; None where it answered
    world_um: tuple[float, float] | None = None
    target_um: tuple[float, float] | None = None  # in the target's true frame
    theta_rad: float | None = None  # None: no angle given
    score: float | None = None
    spread_um: float | None = None  # the chain's own estimate
    spread_theta_rad: float | None = None
    # the one direction, in the target's true frame, in which the position is known: the
    # errors above are the part along it
    axis_rad: float | None = None
    depth_um: float | None = None  # how far out of focus the chain says it is
    z_um: float | None = None  # error of the focus, or of its size alone
    zoom: float | None = None  # error of the ratio to nominal
    # by how far the picture's discrepancy moved the answer, in the target's frame, and
    # turned it; None: it is not known
    moved_um: tuple[float, float] | None = None
    moved_rad: float | None = None
    corner: bool = False  # of a corner of what is tried: in no sigma, in no bias

    @property
    def distance_um(self) -> float:
        """Return the length of the error, infinite where there is no answer."""
        return math.inf if self.world_um is None else math.hypot(*self.world_um)


# A row: numbers of the chain and of the failure's code or -1, the trial, which of the
# fields below are given and whether it is a corner (a bit each), and the fields, 0
# where they are not.
_PAIRS = ("world_um", "target_um", "moved_um")
_SINGLES = (
    "theta_rad", "score", "spread_um", "spread_theta_rad", "axis_rad", "depth_um",
    "z_um", "zoom", "moved_rad",
)  # fmt: skip
_FIELDS = (*_PAIRS, *_SINGLES)
_CORNER = 1 << len(_FIELDS)
_COLUMNS = 4 + 2 * len(_PAIRS) + len(_SINGLES)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcomes(Sequence[Outcome]):
    """Outcomes in order; each is made when it is asked for."""

    chains: tuple[Chain, ...]
    codes: tuple[str, ...]  # of failures
    rows: FloatArray  # (N, `_COLUMNS`)

    @classmethod
    def of(cls, outcomes: Iterable[Outcome] = ()) -> Outcomes:
        """Return outcomes as rows."""
        if isinstance(outcomes, Outcomes):
            return outcomes
        book = Book()
        for outcome in outcomes:
            book.add(outcome)
        return book.all()

    def __len__(self) -> int:
        """Return how many outcomes there are."""
        return len(self.rows)

    @overload
    def __getitem__(self, at: int) -> Outcome: ...

    @overload
    def __getitem__(self, at: slice) -> Outcomes: ...

    def __getitem__(self, at: int | slice) -> Outcome | Outcomes:
        """Return an outcome, or some of them."""
        if isinstance(at, slice):
            return replace(self, rows=self.rows[at])
        return self._made(self.rows[at].tolist())

    def __iter__(self) -> Iterator[Outcome]:
        """Yield the outcomes."""
        for start in range(0, len(self), _AT_ONCE):
            yield from map(self._made, self.rows[start : start + _AT_ONCE].tolist())

    def __eq__(self, other: object) -> bool:
        """Return whether the other ones are the same, in the same order."""
        if not isinstance(other, Outcomes):
            return NotImplemented
        return len(self) == len(other) and all(map(operator.eq, self, other))

    __hash__ = None  # type: ignore[assignment]  # as of all that compares arrays

    def __add__(self, other: Outcomes) -> Outcomes:
        """Return these outcomes, and the other ones after them."""
        if not (len(self) and len(other)):
            return self if len(self) else other
        chains = tuple(dict.fromkeys(self.chains + other.chains))
        codes = tuple(dict.fromkeys(self.codes + other.codes))
        both = [_numbered(each, chains, codes) for each in (self, other)]
        return Outcomes(chains=chains, codes=codes, rows=np.concatenate(both))

    def by(self, chain: Chain) -> Outcomes:
        """Return those of one chain."""
        if self.chains == (chain,):
            return self
        number = self.chains.index(chain) if chain in self.chains else -1
        return replace(self, rows=self.rows[self.rows[:, 0] == number])

    def only(self, is_wanted: Callable[[Outcome], bool]) -> Outcomes:
        """Return those for which a test holds."""
        found = np.fromiter(map(is_wanted, self), dtype=bool, count=len(self))
        return replace(self, rows=self.rows[found])

    def _made(self, row: Sequence[float]) -> Outcome:
        """Return the outcome of a row."""
        chain, code, trial, given = map(int, row[:4])
        singles = 4 + 2 * len(_PAIRS)
        pairs = (tuple(row[at : at + 2]) for at in range(4, singles, 2))
        values = (*pairs, *row[singles:])
        fields = {
            name: value if given >> bit & 1 else None
            for bit, (name, value) in enumerate(zip(_FIELDS, values, strict=True))
        }
        return Outcome(
            chain=self.chains[chain],
            trial=trial,
            failure=None if code < 0 else self.codes[code],
            corner=bool(given & _CORNER),
            **fields,  # type: ignore[arg-type]  # mypy knows no names of fields
        )


def _numbered(
    outcomes: Outcomes, chains: tuple[Chain, ...], codes: tuple[str, ...]
) -> FloatArray:
    """Return rows by the numbers that chains and codes have elsewhere."""
    if (outcomes.chains, outcomes.codes) == (chains, codes):
        return outcomes.rows
    rows = outcomes.rows.copy()
    names = (outcomes.chains, chains), (outcomes.codes, codes)
    for column, (here, there) in enumerate(names):
        numbers = np.array([*map(there.index, here), -1])  # at -1: no code
        rows[:, column] = numbers[rows[:, column].astype(np.intp)]
    return rows


@dataclass(slots=True)
class Book:
    """Outcomes as they are found, by chain and trial."""

    chains: dict[Chain, int] = field(default_factory=dict)
    codes: dict[str, int] = field(default_factory=dict)
    _numbers: array[float] = field(default_factory=lambda: array("d"))
    # by chain: the row of each trial, -1 where there is none
    _places: dict[Chain, array[int]] = field(default_factory=dict)

    def __contains__(self, key: tuple[Chain, int]) -> bool:
        """Return whether there is an outcome of a chain and a trial."""
        chain, trial = key
        places = self._places.get(chain, ())
        return trial < len(places) and places[trial] >= 0

    def add(self, outcome: Outcome) -> None:
        """Write an outcome down."""
        row = array("d", self._row(outcome))  # whole: what is no number adds nothing
        places = self._places.setdefault(outcome.chain, array("i"))
        places.extend([-1] * (outcome.trial + 1 - len(places)))
        places[outcome.trial] = len(self._numbers) // _COLUMNS
        self._numbers.extend(row)

    def all(self) -> Outcomes:
        """Return all outcomes, in the order in which they were written down."""
        return self._outcomes(slice(None))

    def pick(self, keys: Iterable[tuple[Chain, int]]) -> Outcomes:
        """Return outcomes by chain and trial; raise KeyError where there is none."""
        return self._outcomes(np.fromiter(map(self._place, keys), dtype=np.intp))

    def _place(self, key: tuple[Chain, int]) -> int:
        """Return the row of an outcome."""
        if key not in self:
            raise KeyError(key)
        chain, trial = key
        return self._places[chain][trial]

    def _outcomes(self, which: slice | npt.NDArray[np.intp]) -> Outcomes:
        rows = np.asarray(self._numbers, dtype=np.float64).reshape(-1, _COLUMNS)
        return Outcomes(
            chains=tuple(self.chains), codes=tuple(self.codes), rows=rows[which].copy()
        )

    def _row(self, outcome: Outcome) -> Iterator[float]:
        """Yield the numbers of an outcome."""
        yield self.chains.setdefault(outcome.chain, len(self.chains))
        code = outcome.failure
        yield -1 if code is None else self.codes.setdefault(code, len(self.codes))
        yield outcome.trial
        yield (_CORNER if outcome.corner else 0) + sum(
            1 << k for k, n in enumerate(_FIELDS) if getattr(outcome, n) is not None
        )
        for name in _PAIRS:
            yield from getattr(outcome, name) or (0.0, 0.0)
        for name in _SINGLES:
            value = getattr(outcome, name)
            yield 0.0 if value is None else value
