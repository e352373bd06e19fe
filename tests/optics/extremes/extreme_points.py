"""Extreme points of `optics`: what is called, with what, and what must come out.

The list is `extremes.json`, made by `make_extremes.py`; here each kind of point is
turned into one number. A nan, an infinity or a warning is a failure, as a wrong value
is.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.defocus.model_error import model_error_bound
from microplan.arrays import FloatArray
from microplan.optics.lens.jacobian import point_jacobian
from microplan.optics.lens.sensor import Sensor, expose
from microplan.optics.render.render import render
from microplan.optics.render.spectrum import Tile, spectrum
from microplan.optics.transfer import otf
from microplan.optics.transfer.models import tabulate, transfer
from tests.optics.extremes.extreme_chains import CHAINS
from tests.optics.extremes.extreme_givens import Given, optics_of, scene_of, shape_of

LIST = Path(__file__).with_name("extremes.json")


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One extreme point."""

    call: str  # a key of `CALLS`
    given: Given
    expected: float
    allowed: float  # absolute
    source: str  # where `expected` and `allowed` come from

    @property
    def name(self) -> str:
        """Return a short name, the same in tests and documents."""
        given = ", ".join(f"{key}={value}" for key, value in self.given.items())
        return f"{self.call}({given})"

    def found(self) -> float:
        """Return what `optics` makes of it; warnings are raised as errors."""
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return float(CALLS[self.call](self.given))

    def holds(self) -> bool:
        """Return whether a finite number came out, without a warning, and the right."""
        try:
            found = self.found()
        except (ArithmeticError, ValueError, IndexError, Warning):
            return False
        return math.isfinite(found) and abs(found - self.expected) <= self.allowed


def points() -> tuple[Point, ...]:
    """Return the list."""
    entries = json.loads(LIST.read_text(encoding="utf-8"))["points"]
    return tuple(
        Point(**(entry | {"expected": float(entry["expected"])})) for entry in entries
    )


def table_rows() -> list[str]:
    """Return one row of a Markdown table for each kind of point."""
    kinds: dict[str, list[Point]] = {}
    for point in points():
        kinds.setdefault(point.call, []).append(point)
    return [
        f"| `{call}` | {len(some)} | {_range(some)} "
        f"| {max(point.allowed for point in some):.2g} | {_sources(some)} |"
        for call, some in kinds.items()
    ]


def _range(some: Sequence[Point]) -> str:
    """Return each given number with its least and largest value."""
    numbers: dict[str, list[float]] = {}
    for point in some:
        for key, value in point.given.items():
            if isinstance(value, (int, float)):
                numbers.setdefault(key, []).append(value)
    ranges = ((key, min(values), max(values)) for key, values in numbers.items())
    return ", ".join(
        f"{key} {low:g}" + (f" to {high:g}" if high > low else "")
        for key, low, high in ranges
    )


def _sources(some: Sequence[Point]) -> str:
    return "; ".join(dict.fromkeys(point.source for point in some))


def _x(g: Given) -> FloatArray:
    return np.array([g["x"]])


def _exact(g: Given) -> float:
    value = otf.exact(
        _x(g),
        z_um=g["z_um"],
        aperture=g["aperture"],
        wavelength_um=0.6,
        index=g.get("index", 1.0),
    )
    return float(value[0])


def _transfer(g: Given) -> float:
    optics = optics_of(g)
    f = _x(g) * optics.cutoff_per_um
    return float(transfer(g["model"], optics, g["z_um"], f)[0])


def _table(g: Given) -> float:
    table = tabulate(g["model"], optics_of(g), g["z_um"], g["x_max"])
    return float(table.read(_x(g))[0])


def _number(name: str) -> Callable[[Given], float]:
    """Return the call of a property, or of a method of the defocus."""

    def read(g: Given) -> float:
        value = getattr(optics_of(g), name)
        return float(value(g["z_um"]) if callable(value) else value)

    return read


def _image(g: Given) -> FloatArray:
    model = g.get("model", "exact")
    return render(scene_of(g), optics_of(g), focus_um=0.0, model=model)


def _centre(g: Given) -> float:
    image = _image(g)
    row, column = (count // 2 for count in image.shape)
    return float(image[row, column + g.get("right_px", 0)])


def _worst(g: Given) -> float:
    """Return the value of the frame farthest from `expected`."""
    image = _image(g).ravel()
    return float(image[np.argmax(np.abs(image - g["all"]))])


def _energy(g: Given) -> float:
    """Return the sum over pixels times their area: the area of the part, um2."""
    return float(_image(g).sum() * optics_of(g).um_per_px ** 2)


def _symmetry(g: Given) -> float:
    """Return the largest difference between +z and -z."""
    other = dict(g) | {"z_um": -g["z_um"]}
    return float(np.abs(_image(g) - _image(other)).max())


def _change(g: Given) -> float:
    """Return the largest difference from the image in focus."""
    return float(np.abs(_image(g) - _image(dict(g) | {"z_um": 0.0})).max())


def _coefficient(g: Given) -> float:
    """Return the real part of a coefficient times the tile's area, um2."""
    side = g["tile_um"]
    tile = Tile(left_um=-side / 2, bottom_um=-side / 2, width_um=side, height_um=side)
    found = spectrum(shape_of(g), tile, g["cut_per_um"])
    j, k = g["order"]
    # the spectrum counts from the tile's lower left corner
    turned = found.values[k, j] * np.exp(1j * np.pi * (j + k))
    return float(turned.real * side**2)


def _counts(g: Given) -> float:
    """Return the mean count of 1000 pixels of one brightness."""
    sensor = Sensor(
        full_well_e=g["full_well_e"],
        read_noise_e=g["read_noise_e"],
        bits=g["bits"],
        gain=g.get("gain", 1.0),
    )
    frame = expose(np.full(1000, g["light"]), sensor, np.random.default_rng(1))
    return float(frame.mean())


def _point(g: Given) -> float:
    at = np.array([g["at_px"]], dtype=np.float64)
    axis = tuple(g.get("axis_um", (0.0, 0.0)))
    found = point_jacobian(at, optics_of(g), axis_um=(axis[0], axis[1]))
    return float(found[g["row"], g["column"]])


CALLS: Mapping[str, Callable[[Given], float]] = {
    "diffraction": lambda g: float(otf.diffraction(_x(g))[0]),
    "geometric": lambda g: float(otf.geometric(_x(g), g["w"])[0]),
    "product": lambda g: float(otf.product(_x(g), g["w"])[0]),
    "stokseth": lambda g: float(otf.stokseth(_x(g), g["w"])[0]),
    "hopkins": lambda g: float(otf.hopkins(_x(g), g["w"])[0]),
    "exact": _exact,
    "transfer": _transfer,
    "table": _table,
    "model_error": lambda g: model_error_bound(g["model"], optics_of(g), g["z_um"]),
    **{
        name: _number(name)
        for name in (
            "airy_radius_um",
            "wave_depth_um",
            "wave_depth_exact_um",
            "rim_w20_um",
            "paraxial_w20_um",
            "blur_diameter_um",
        )
    },
    "coefficient": _coefficient,
    "image.centre": _centre,
    "image.worst": _worst,
    "image.energy": _energy,
    "image.symmetry": _symmetry,
    "image.change": _change,
    "sensor.mean": _counts,
    "jacobian.point": _point,
    **CHAINS,
}
