"""Maps of what the defocus laws and their tables err by, over their whole domain.

Measured against the exact phase for W20 of .01 to 1000 waves and A of .05 to .95 n:
in the transfer, and in images of unit contrast of shapes of every size (a straight
edge, slots, discs, gratings), next to what `microplan.optics.transfer.models`
predicts for any shape. Maps go to `build/error_maps`, as numbers (csv) and as pictures
(png).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import j1

from benchmarks.defocus.law_bounds import (
    LAWS,
    bounds,
    defocus_um,
    differences,
    frequencies,
    pixel_bounds,
    reach_um,
    setting,
)
from benchmarks.defocus.map_pictures import Grid, draw_laws, draw_tables, save_csv
from benchmarks.defocus.model_error import model_error_bound
from benchmarks.figures import Benchmark, Figure, Options
from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import MODELS, TABLE_ERROR, tabulate, transfer

Maps = dict[str, FloatArray]  # (waves, steepness), by "law.kind" or by model

FOLDER = Path(__file__).parents[2] / "build" / "error_maps"
WAVES = np.geomspace(0.01, 1000, 16)
STEEPNESS = np.array([0.05, 0.1, 0.2, 0.3, 0.42, 0.55, 0.7, 0.8, 0.9, 0.95])
SHAPES = ("edge", "slot", "disc", "grating")
KINDS = ("transfer", *SHAPES, "predicted")
DEFOCUS_UM = np.array([0, 1e-12, 1e-3, 0.1, 1, 10, 100, 1e3, 1e4, 1e5, 1e6])
TABLE_STEEPNESS = np.array([1e-3, 0.05, 0.2, 0.42, 0.7, 0.9, 0.95, 0.99, 0.999])
_SIZES = 300  # of each shape, from a third of the Airy radius to beyond the blur
_PLACES = 200  # where fresh integrals are compared with the law table
_PHASE_WAVES = 100.0  # beyond it tables reach up to a share of the cutoff only


def law_maps() -> Maps:
    """Return measured and predicted errors as "law.kind": (waves, steepness)."""
    shape = (WAVES.size, STEEPNESS.size)
    maps = {f"{law}.{kind}": np.zeros(shape) for law in LAWS for kind in KINDS}
    for i, waves in enumerate(WAVES):
        for j, steepness in enumerate(STEEPNESS):
            for name, error in errors(float(waves), float(steepness)).items():
                maps[name][i, j] = error
    return maps


def errors(waves: float, steepness: float) -> dict[str, float]:
    """Return the errors of all laws at one place of the map, by "law.kind"."""
    optics = setting(steepness)
    z_um = defocus_um(optics, waves)
    reach = reach_um(optics, z_um)
    f, weight = frequencies(optics.cutoff_per_um, reach)
    changes = differences(optics, z_um, f / optics.cutoff_per_um)
    stack = np.stack([changes[law] for law in LAWS], axis=1)
    sizes = np.geomspace(0.2, reach, _SIZES)
    found = {
        "transfer": np.abs(stack).max(axis=0),
        "edge": np.abs(_edges(sizes, f, weight, stack)).max(axis=0),
        "disc": np.abs(_discs(sizes, f, weight, stack)).max(axis=0),
        "grating": _gratings(optics, z_um, sizes),
    }
    # of width d, at x: the edge's error at x + d / 2 less that at x - d / 2; it is odd
    found["slot"] = 2 * found["edge"]
    predicted = [model_error_bound(law, optics, z_um) for law in LAWS]
    found["predicted"] = np.array(predicted)
    return {
        f"{law}.{kind}": float(found[kind][k])
        for k, law in enumerate(LAWS)
        for kind in KINDS
    }


def table_maps() -> Maps:
    """Return what each model's table errs by as a transfer, (defocus, steepness)."""
    maps = {
        model: np.zeros((DEFOCUS_UM.size, TABLE_STEEPNESS.size)) for model in MODELS
    }
    for i, z_um in enumerate(DEFOCUS_UM):
        for j, steepness in enumerate(TABLE_STEEPNESS):
            for model in MODELS:
                maps[model][i, j] = table_error(model, float(z_um), float(steepness))
    return maps


def table_error(model: str, z_um: float, steepness: float) -> float:
    """Return the largest error of a table at random frequencies, fine and coarse."""
    optics = Microscope(
        aperture=steepness,
        wavelength_um=0.6,
        medium_index=1.0,
        magnification=10,
        pitch_um=7.5,
        width_px=1,
        height_px=1,
    )
    turns = optics.blur_diameter_um(z_um) * optics.cutoff_per_um / 8  # W20 if small
    x_max = min(1.0, _PHASE_WAVES / max(turns, 1e-300))
    table = tabulate(model, optics, z_um, x_max)
    rng = np.random.default_rng(7)
    x = x_max * np.concatenate(
        [
            rng.random(800),
            10 ** rng.uniform(-9, 0, 800),
            1 - 10 ** rng.uniform(-9, 0, 99),
        ]
    )
    exact = transfer(model, optics, z_um, x * optics.cutoff_per_um)
    return float(np.abs(table.read(x) - exact).max())


def bound_shares(count: int) -> FloatArray:
    """Return fresh integrals over predictions, between the table's nodes at random.

    (count, laws, 2): alone, and averaged over a random pixel.
    """
    rng = np.random.default_rng(3)
    shares = np.zeros((count, len(LAWS), 2))
    for place in shares:
        waves, steepness = 10 ** rng.uniform(-2.3, 1), rng.uniform(0.05, 0.95)
        pixel = 10 ** rng.uniform(-0.6, 1.5)
        optics = setting(steepness)
        coarse = replace(optics, pitch_um=pixel)
        z_um = defocus_um(optics, waves)
        alone = bounds(waves, steepness)
        averaged = pixel_bounds(waves, steepness, np.array([pixel]))
        for share, law in zip(place, LAWS, strict=True):
            share[0] = _share(alone[law], model_error_bound(law, optics, z_um))
            share[1] = _share(averaged[law][0], model_error_bound(law, coarse, z_um))
    return shares


def _share(integral: float, predicted: float) -> float:
    """Return integral over prediction; 0 where the prediction promises nothing."""
    return integral / predicted if predicted < 1 else 0.0


def _edges(
    x_um: FloatArray, f: FloatArray, weight: FloatArray, change: FloatArray
) -> FloatArray:
    """Return the change of an edge's image `x_um` from it, (N, laws)."""
    terms = (weight / (np.pi * f))[:, None] * change
    found: FloatArray = _by_parts(np.sin, x_um, f, terms)
    return found


def _discs(
    radius_um: FloatArray, f: FloatArray, weight: FloatArray, change: FloatArray
) -> FloatArray:
    """Return the change in the middle of a disc, (N, laws)."""
    terms = 2 * np.pi * weight[:, None] * change
    found: FloatArray = radius_um[:, None] * _by_parts(j1, radius_um, f, terms)
    return found


def _by_parts(
    wave: np.ufunc, at_um: FloatArray, f: FloatArray, terms: FloatArray
) -> FloatArray:
    """Return wave(2 pi at f) @ terms without holding all of it."""
    parts = np.array_split(np.arange(f.size), 1 + f.size * at_um.size // 4_000_000)
    return np.asarray(
        sum(wave(2 * np.pi * at_um[:, None] * f[part]) @ terms[part] for part in parts)
    )


def _gratings(optics: Microscope, z_um: float, period_um: FloatArray) -> FloatArray:
    """Return the largest change in the middle of a bar of even gratings, (laws,)."""
    order = np.arange(1, 60, 2)
    x = order / period_um[:, None] / optics.cutoff_per_um
    sign = np.where(order % 4 == 1, 1.0, -1.0) * 2 / (np.pi * order)
    changes = differences(optics, z_um, np.minimum(x, 1.0).ravel())
    values = (np.where(x < 1, changes[law].reshape(x.shape), 0) for law in LAWS)
    return np.array([np.abs(value @ sign).max() for value in values])


def shares(laws: Maps) -> Maps:
    """Return the worst shape's error over the predicted one as "law.share"."""
    return {
        f"{law}.share": np.max([laws[f"{law}.{shape}"] for shape in SHAPES], axis=0)
        / laws[f"{law}.predicted"]
        for law in LAWS
    }


def _measure(_options: Options) -> Iterator[Figure]:
    laws, tables = law_maps(), table_maps()
    laws |= shares(laws)
    _keep(laws, tables)
    for law in LAWS:
        for kind in ("transfer", "edge"):
            value = float(laws[f"{law}.{kind}"].max())
            yield Figure(name=f"maps.{law}.{kind}", value=value, unit="1")
    medians = {
        shape: float(
            np.median([laws[f"{n}.{shape}"] / laws[f"{n}.predicted"] for n in LAWS])
        )
        for shape in SHAPES
    }
    share = np.stack([laws[f"{law}.share"] for law in LAWS])
    bound = float(bound_shares(_PLACES).max())
    table = max(float(value.max()) for value in tables.values())
    for name, value in (
        ("laws.worst_share", float(share.max())),
        ("laws.worst_bound_share", bound),
        ("laws.median_overestimate", float(np.median(1 / share))),
        *((f"laws.median_share.{shape}", medians[shape]) for shape in SHAPES),
        ("tables.max_error", table),
    ):
        yield Figure(name=f"maps.{name}", value=value, unit="1")


BENCHMARK = Benchmark(
    names=(
        *(f"maps.{law}.{kind}" for law in LAWS for kind in ("transfer", "edge")),
        "maps.laws.worst_share",
        "maps.laws.worst_bound_share",
        "maps.laws.median_overestimate",
        *(f"maps.laws.median_share.{shape}" for shape in SHAPES),
        "maps.tables.max_error",
    ),
    measure=_measure,
)


def _keep(laws: Maps, tables: Maps) -> None:
    """Write the maps as numbers and pictures."""
    places = Grid(
        down=WAVES, down_name="w20_waves", right=STEEPNESS, right_name="a_over_n"
    )
    save_csv(FOLDER / "laws.csv", places, laws)
    draw_laws(FOLDER / "laws.png", places, LAWS, KINDS, laws)
    settings = Grid(
        down=DEFOCUS_UM,
        down_name="defocus_um",
        right=TABLE_STEEPNESS,
        right_name="a_over_n",
    )
    save_csv(FOLDER / "tables.csv", settings, tables)
    draw_tables(FOLDER / "tables.png", settings, tables, TABLE_ERROR)


if __name__ == "__main__":
    for each in _measure(Options()):
        print(each.form())
