"""Points of the localisation benchmark: their trials, limits, sums and tables."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from benchmarks.figures import Benchmark
from benchmarks.localisation.convergence import (
    BENCHMARK,
    SAMPLE,
    _modules,
    main,
    measure_all,
)
from benchmarks.localisation.points import HEIGHTS_UM, PART, costs, lines, points, units
from benchmarks.localisation.record import code_of
from benchmarks.localisation.scenes import (
    CONDITIONS,
    FITTED,
    SCENES,
    disturbed,
    draws,
    free_names,
)
from benchmarks.localisation.trials import (
    SEED,
    Part,
    Unit,
    is_right,
    limit_squared,
    summed,
)
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import limit
from microplan.featuresel.look.sensitivity import sensitivities
from microplan.featuresel.routines.contract import Failure

FEW = Unit(
    way="likelihood", scene="shaft", condition="plain", z_um=5.0, part=0, trials=2
)


def test_all_points_have_all_their_trials() -> None:
    found = units(1500)
    assert len(set(found)) == len(found)
    trials: Counter[tuple[str, str, str, float]] = Counter()
    for unit in found:
        trials[unit.way, unit.scene, unit.condition, unit.z_um] += unit.trials
    assert set(trials.values()) == {1500}
    for scene in FITTED:
        for condition in CONDITIONS:
            fits = [trials["likelihood", scene, condition, z] for z in HEIGHTS_UM]
            none = scene == condition == "fingers"  # they do not hide themselves
            assert fits == [0 if none else 1500] * 4


@pytest.mark.parametrize("way", sorted({unit.way for unit in units(1500)}))
def test_a_result_depends_on_the_code_of_its_routine(way: str) -> None:
    modules = [import_module(name) for name in _modules(way)]
    assert all(hasattr(module, "__path__") is False for module in modules)
    assert len(code_of(*_modules(way))) == 16


def test_a_part_s_images_depend_on_nothing_but_the_unit() -> None:
    case = disturbed(SCENES["shaft"](), "plain")
    first, same = (list(draws(case, 5.0, n, SEED, part=1)) for n in (3, 2))
    for one, other in zip(first, same, strict=False):
        assert one.setting == other.setting
        np.testing.assert_array_equal(one.image, other.image)
    (another,) = draws(case, 5.0, 1, SEED, part=2)
    assert another.setting != first[0].setting
    (higher,) = draws(case, 10.0, 1, SEED, part=1)
    assert higher.setting == replace(first[0].setting, dz_um=10.0)
    # read noise of 10 and shot noise of 10 000 e: 1e-3 and about 8e-3 of full scale
    assert np.std(first[0].image[:8] - higher.image[:8]) > 4e-3  # another noise


def test_a_limit_in_other_light_is_that_of_slopes_seen_in_it() -> None:
    case = disturbed(SCENES["shaft"](), "all")
    (drawn,) = draws(case, 5.0, 1, SEED)
    exact, setting = replace(case, model="exact"), drawn.setting
    assert setting.gain != 1
    assert setting.gradient_x != 0
    seen = sensitivities(exact, setting, free_names(case))
    known = limit(fisher(seen, camera_of(exact)))
    found = limit_squared(case, [setting])
    np.testing.assert_allclose(found[0], known["x"] ** 2, rtol=1e-9)
    np.testing.assert_allclose(found[1], known["y"] ** 2, rtol=1e-9)
    assert math.isnan(found[2])  # a circle has no angle


def test_wrong_answers_are_silent_failures_and_not_part_of_the_rms() -> None:
    loud = Failure(code="misfit", message="")
    wrong = [(0.9, 0.9, 0.0), (0.0, 0.0, 0.03)]
    right = [(0.3, -0.4, 0.01), (0.1, 0.0, 0.0)]
    part = summed([*wrong, loud, *right], (0.04, 0.01, 1e-4), (1.0, 2.0, 3.0))
    assert (part.trials, part.failed, part.silent) == (5, 1, 2)
    np.testing.assert_allclose(part.sums, (0.4, -0.4, 0.01))
    np.testing.assert_allclose(part.squares, (0.1, 0.16, 1e-4))
    assert part.codes == ("misfit",)
    assert not is_right((1.1, 0.0))
    assert is_right((0.1,))


def test_parts_of_a_point_add_up() -> None:
    part = Part(
        trials=4, failed=1, silent=1, sums=(0.2, 0.0), squares=(0.02, 0.08),
        limit_squared=(0.01, 0.04), codes=("misfit",), cpu_s=(1.0, 2.0, 0.5),
    )  # fmt: skip
    other = replace(part, failed=3, sums=(0.0, 0.0), squares=(0.0, 0.0), silent=1)
    other = replace(other, codes=("outside",) * 3, limit_squared=(0.03, 0.04))
    pairs = [(replace(FEW, part=k, trials=4), p) for k, p in enumerate((part, other))]
    (point,) = points(pairs)
    assert (point.trials, point.failed, point.silent) == (8, 4, 2)
    np.testing.assert_allclose(point.rms, (0.1, 0.2))  # of two right answers
    np.testing.assert_allclose(point.limit, (math.sqrt(0.02), 0.2))
    np.testing.assert_allclose(point.bias, (0.1, 0.0))
    *_, line = lines([point])
    cells = [cell.strip() for cell in line.split("|")[1:-1]]
    assert cells == ["plain", "5", "0.71", "1.00", "4 outside", "2", "8", "500"]
    *_, total = costs([point], 8 * 60)  # (2 + 4) s each 8, .5 s for each of 2 units
    assert f"{8 * 60} trials a point: 6 min" in total


def test_a_point_at_which_nothing_is_right_has_empty_cells() -> None:
    part = summed([Failure(code="ambiguous", message="")] * 2, (1e-6, 1e-6), (1, 1, 1))
    (point,) = points([(FEW, part)])
    *_, line = lines([point])
    assert line == "| plain | 5 |  |  | 2 ambiguous | 0 | 2 | 500 |"


@pytest.mark.slow
def test_units_that_are_recorded_are_not_measured_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "record.jsonl"
    assert list(measure_all([FEW], 0, path)) == []
    ((unit, part),) = measure_all([FEW], 1, path)
    assert unit == FEW
    assert part.trials == 2
    written = path.read_text(encoding="utf-8")
    assert list(measure_all([FEW], 0, path)) == [(FEW, part)]  # also its CPU times
    assert path.read_text(encoding="utf-8") == written
    words = ["--trials", "2", "--scene", "shaft", "--height", "5", "--show"]
    assert main([*words, "--record", str(path)]) == 0
    assert capsys.readouterr().out.count("| plain | 5 |") == 1
    fresh = next(iter(measure_all([FEW], 1, None)))[1]
    assert replace(fresh, cpu_s=part.cpu_s) == part


def test_what_make_bench_measures_is_the_first_part_of_points_of_the_table() -> None:
    assert isinstance(BENCHMARK, Benchmark)
    known = set(units(1500))
    for way, scene, condition, z_um in SAMPLE:
        unit = Unit(
            way=way, scene=scene, condition=condition, z_um=z_um, part=0, trials=PART
        )
        assert unit in known
        assert any(f"{scene}.z{z_um:g}.{condition}.{way}" in n for n in BENCHMARK.names)
