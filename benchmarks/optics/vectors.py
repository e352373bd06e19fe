"""Optics against the reference vectors, which were computed with 17 digits."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction, exact, geometric, hopkins

VECTORS = Path(__file__).parents[2] / "tests" / "optics" / "optics_vectors.json"
Given = Mapping[str, float]


def worst_error() -> float:
    """Return the largest difference from any vector, in the vector's own unit."""
    entries = json.loads(VECTORS.read_text(encoding="utf-8"))["entries"]
    errors = []
    for entry in entries:
        given = {key: float(value) for key, value in entry["params"].items()}
        errors.append(abs(_OURS[entry["name"]](given) - float(entry["value"])))
    return float(max(errors))


def _measure(_options: Options) -> Iterator[Figure]:
    yield Figure(name="optics.vectors_max_abs_error", value=worst_error(), unit="1")


BENCHMARK = Benchmark(names=("optics.vectors_max_abs_error",), measure=_measure)


def _microscope(given: Given) -> Microscope:
    """Return the setting a vector speaks of; what it leaves out does not matter."""
    m = given.get("m", 1.0)
    pitch_um = given.get("b_um", 7.5)
    return Microscope(
        aperture=given["A"],
        wavelength_um=given.get("lambda_um", 0.6),
        medium_index=given["n"],
        magnification=m,
        pitch_um=pitch_um,
        width_px=640,
        height_px=480,
    )


def _edge_spread(given: Given) -> float:
    """Return the image of an edge, X in wavelengths over A from it."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    v = (1 + nodes) / 2
    x = 1 - v**2  # in v the transfer's (1 - x)**1.5 is smooth
    wave = np.sin(4 * np.pi * x * given["X"]) / (np.pi * x)
    return 0.5 + float((weights * v * hopkins(x, given["w"]) * wave).sum())


def _high_aperture(given: Given) -> float:
    value = exact(
        np.array([given["x"]]),
        z_um=given["Delta_um"],
        aperture=given["A"],
        wavelength_um=given["lambda_um"],
        index=given["n"],
    )
    return float(value[0])


def paper_depth_of_field_um(microscope: Microscope) -> float:
    """Return the paper's depth of field, um.

    The paper puts the pixel for the blur (12.45 um) and 1.5 for the index. The
    formula takes one blur width from another, which is not how they add: it becomes
    negative at high magnification. Use `Microscope.wave_depth_um`.

    References
    ----------
    Feddema & Simon (1998), eq. (5): .2196 um.
    """
    n, A = microscope.medium_index, microscope.aperture
    pixel = n * microscope.pitch_um / (microscope.magnification * A)
    return pixel - 1.22 * microscope.wavelength_um * n / A**2


def paper_blur_um(microscope: Microscope, z_um: float) -> float:
    """Return the blur circle of eqs. (2, 3), 2 |z| A / n, in object space, um."""
    return 2 * abs(z_um) * microscope.aperture / microscope.medium_index


_OURS: Mapping[str, Callable[[Given], float]] = {
    "otf_diffraction": lambda g: float(diffraction(np.array([g["x"]]))[0]),
    "otf_defocus_hopkins": lambda g: float(hopkins(np.array([g["x"]]), g["w"])[0]),
    "otf_disk": lambda g: float(geometric(np.array([g["z"] / (8 * np.pi)]), 1.0)[0]),
    "otf_defocus_high_na": _high_aperture,
    "edge_spread": _edge_spread,
    "paper_eq5_total_dof_um": lambda g: paper_depth_of_field_um(_microscope(g)),
    "dof_wave_quadratic_um": lambda g: _microscope(g).wave_depth_um,
    "dof_wave_exact_um": lambda g: _microscope(g).wave_depth_exact_um,
    "geometric_blur_object_um": lambda g: paper_blur_um(_microscope(g), g["Delta_um"]),
    "geometric_blur_object_tan_um": lambda g: _microscope(g).blur_diameter_um(
        g["Delta_um"]
    ),
}
