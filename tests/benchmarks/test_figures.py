"""Figures as printed and kept, and their selection by name."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.catalogue import BENCHMARKS
from benchmarks.figures import Benchmark, Figure, Options, run, select, write


def _benchmark(*names: str, made: tuple[str, ...] | None = None) -> Benchmark:
    def measure(_options: Options) -> Iterator[Figure]:
        for name in names if made is None else made:
            yield Figure(name=name, value=1.0, unit="1")

    return Benchmark(names=names, measure=measure)


KNOWN = (_benchmark("a.x", "a.y"), _benchmark("ab.x"), _benchmark("c"))


def test_ratios_are_value_over_floor_and_over_rival() -> None:
    figure = Figure(name="a", value=6.0, unit="ms", floor=2.0, rival=12.0)
    assert figure.form() == {
        "name": "a", "value": 6.0, "unit": "ms",
        "floor": 2.0, "ratio_floor": 3.0, "rival": 12.0, "ratio_rival": 0.5,
    }  # fmt: skip


def test_a_figure_without_comparison_has_no_such_keys() -> None:
    assert Figure(name="a", value=0.0, unit="1").form().keys() == {
        "name",
        "value",
        "unit",
    }


def test_a_time_is_not_below_its_floor() -> None:
    with pytest.raises(ValueError, match="less than its floor"):
        Figure(name="a", value=1.0, unit="ms", floor=2.0)
    assert Figure(name="a", value=1.0, unit="nm", floor=2.0).floor == 2.0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_figure_is_finite(value: float) -> None:
    with pytest.raises(ValueError, match="must be finite"):
        Figure(name="a", value=value, unit="1")


def test_nothing_is_divided_by_zero() -> None:
    with pytest.raises(ValueError, match="divided by 0"):
        Figure(name="a", value=1.0, unit="1", floor=0.0)


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ([], ["a.x", "ab.x", "c"]),
        (["a"], ["a.x"]),  # whole words: not ab
        (["a.y"], ["a.x"]),  # with the figures measured beside it
        (["c", "ab"], ["ab.x", "c"]),  # in the catalogue's order
    ],
)
def test_names_select_benchmarks(wanted: list[str], found: list[str]) -> None:
    assert [b.names[0] for b in select(KNOWN, wanted)] == found


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"no figure 'b', known: a\.x, a\.y, ab\.x, c"):
        select(KNOWN, ["a", "b"])


def test_a_benchmark_makes_the_figures_it_says() -> None:
    assert [f.name for f in run(KNOWN, Options())] == ["a.x", "a.y", "ab.x", "c"]
    liar = _benchmark("a", made=("b",))
    with pytest.raises(ValueError, match=r"made \['b'\], not \['a'\]"):
        list(run([liar], Options()))
    made = _benchmark("a", "b", "c", made=("a", "c"))
    able = replace(made, may_lack=frozenset({"b"}))
    assert [f.name for f in run([able], Options())] == ["a", "c"]
    with pytest.raises(ValueError, match=r"made \['a', 'c'\]"):
        list(run([made], Options()))
    with pytest.raises(ValueError, match=r"made \['a', 'c'\]"):
        list(run([replace(made, may_lack=frozenset({"a"}))], Options()))


def test_every_figure_has_one_name_of_its_own() -> None:
    names = [name for benchmark in BENCHMARKS for name in benchmark.names]
    assert len(set(names)) == len(names)


def test_results_are_a_list(tmp_path: Path) -> None:
    file = tmp_path / "results.json"
    write([Figure(name="a", value=1.5, unit="s")], file)
    assert json.loads(file.read_text()) == [{"name": "a", "value": 1.5, "unit": "s"}]
