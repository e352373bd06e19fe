"""What every routine in the registry keeps, whatever the image."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from typing import get_args

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import NominalRender, nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    PoseTerm,
    TargetKind,
)
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.optics.outline.outline import place
from tests.featuresel.conftest import CASES, bracket, make_case, noisy

LOOKS: dict[TargetKind, str] = {
    "circle": "post", "teeth": "between", "outline": "bracket", "jaws": "jaws",
}  # fmt: skip


@cache
def look(kind: TargetKind) -> LookCase:
    """Return a look at a target of each kind; edges are those of the bracket."""
    if kind in LOOKS:
        return CASES[LOOKS[kind]]()
    (part,) = bracket().moving
    middle: dict[TargetKind, tuple[float, float]] = {
        "edge": (0.0, -50.0), "pair": (0.0, -35.0), "corner": (-60.0, -50.0),
    }  # fmt: skip
    numbers: dict[TargetKind, dict[str, float]] = {
        "edge": {"length_um": 80.0},
        "pair": {"length_um": 50.0, "width_um": 30.0},
        "corner": {"angle_rad": math.pi / 2, "reach_um": 25.0},
    }
    turns = {"edge": -0.5, "pair": -0.5, "corner": -0.75}
    turn, (x, y) = turns[kind] * math.pi, middle[kind]
    c, s = math.cos(turn), math.sin(turn)
    # the part in the feature's frame: shifted there, then turned back
    framed = place(part.outline, -c * x - s * y, s * x - c * y, -turn)
    moving = (replace(part, outline=framed),)
    return make_case(kind, numbers[kind], moving, half_px=(110, 110), key=kind)


@cache
def render(kind: TargetKind) -> NominalRender:
    return nominal_render(look(kind))


@cache
def prepared(name: str, kind: TargetKind) -> Artifact | Failure:
    return load(name).prepare(render(kind), look(kind).target)


def pairs() -> Iterator[tuple[str, TargetKind]]:
    """Yield every routine with every kind it looks for."""
    for name in sorted(REGISTRY):
        for kind in load(name).kinds:
            yield name, kind


def images(kind: TargetKind) -> Iterator[tuple[str, FloatArray]]:
    """Yield what a camera may see besides the target."""
    case = look(kind)
    shape = (case.window.rows, case.window.columns)
    rng = np.random.default_rng(4)
    true = noisy(case, render(kind)(dx_um=0.7, dy_um=-0.4), rng)
    yield "true", true
    yield "blank", np.full(shape, 0.4)
    yield "black", np.zeros(shape)
    yield "saturated", np.ones(shape)
    yield "noise", rng.random(shape)
    yield "negative", 1 - true
    yield "tiny", true[:8, :8].copy()
    yield "half out of view", true[:, : int(case.target.column)].copy()
    yield "rolled", np.roll(true, (shape[0] // 2, shape[1] // 2), (0, 1))


def degenerate(kind: TargetKind) -> Iterator[tuple[str, FloatArray]]:
    """Yield what no camera gives, and a fault in reading one may."""
    case, most = look(kind), float(np.finfo(np.float64).max)
    whole, true = (case.window.rows, case.window.columns), render(kind)()
    for shape in ((0, 0), (0, 5), (5, 0), (1, 1), (1, 640), (640, 1), (3, 3), (2, 40)):
        size = shape[0] * shape[1]
        yield f"a ramp {shape}", np.linspace(0.0, 1.0, size).reshape(shape)
    for value in (np.nan, np.inf, -np.inf, most, -most, 1e3, 1.0, 5e-324, 0.0, -1.0):
        yield f"{value} all over", np.full(whole, value)
    for factor in (most, 1e150, 1e30, 1e-30, 5e-324):
        yield f"{factor} times the image", true * factor
    for value in (np.nan, np.inf, most):
        dotted = true.copy()
        dotted[int(case.target.row) + 3, int(case.target.column) + 3] = value
        yield f"a pixel of {value}", dotted.copy()
        dotted[::7, ::5] = value
        yield f"pixels of {value}", dotted
    yield "extremes", np.random.default_rng(2).choice((most, -most), whole)


def start(kind: TargetKind) -> Guess:
    target = look(kind).target
    return Guess(
        column=target.column, row=target.row, theta_rad=target.theta_rad,
        z_um=0.0, zoom=1.0,
    )  # fmt: skip


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_a_routine_declares_itself(name: str) -> None:
    routine = load(name)
    assert name == routine.name
    assert routine.version
    assert routine.kinds
    assert set(routine.kinds) <= set(get_args(TargetKind))
    assert len(set(routine.kinds)) == len(routine.kinds)
    assert routine.provides
    assert set(routine.provides) | set(routine.requires) <= set(get_args(PoseTerm))
    assert routine.capture_px > 0
    # what starts anywhere needs no place, and what needs one says how near
    assert ("xy" in routine.requires) <= math.isfinite(routine.capture_px)
    assert isinstance(routine.baseline, bool)


# a fit to a circle is prepared in a moment, one to the jaws as long as all the others
EXPENSIVE: set[tuple[str, TargetKind]] = {
    (name, kind)
    for name in ("likelihood", "one_step")
    for kind in ("teeth", "jaws", "outline")
}

every_pair = pytest.mark.parametrize(
    ("name", "kind"),
    [
        pytest.param(*pair, marks=[pytest.mark.slow] if pair in EXPENSIVE else [])
        for pair in pairs()
    ],
)


@every_pair
def test_any_image_has_a_typed_answer(name: str, kind: TargetKind) -> None:
    artifact, routine = prepared(name, kind), load(name)
    if isinstance(artifact, Failure):
        assert artifact.code
        assert artifact.message
        return
    arrays = {key: value.tobytes() for key, value in artifact.arrays.items()}
    for label, image in images(kind):
        frozen = image.copy()
        frozen.setflags(write=False)
        found = routine.measure(frozen, artifact, start(kind))
        _check(name, kind, label, found)
        if label in ("true", "noise"):  # one that is answered, one that is not
            assert routine.measure(image, artifact, start(kind)) == found, label
            assert image.tobytes() == frozen.tobytes(), label
    for key, value in artifact.arrays.items():
        assert value.tobytes() == arrays[key], key


@every_pair
def test_what_is_no_image_is_refused(name: str, kind: TargetKind) -> None:
    artifact = prepared(name, kind)
    if isinstance(artifact, Failure):
        assert artifact.code
        return
    for label, image in degenerate(kind):
        image.setflags(write=False)
        found = measure_chain(image, [(name, artifact)], start(kind))
        assert isinstance(found, Failure), (label, found)
        assert found.code, label
        assert found.message, label


def _check(
    name: str, kind: TargetKind, label: str, found: Measurement | Failure
) -> None:
    """Assert that an answer is one: finite numbers, or a code and a sentence."""
    if isinstance(found, Failure):
        assert found.code, label
        assert found.message, label
        return
    routine, target = load(name), look(kind).target
    assert 0 <= found.score <= 1, label
    numbers = [getattr(found, field.name) for field in fields(found)]
    assert all(math.isfinite(v) for v in numbers if v is not None), label
    assert found.spread_px >= 0, label
    for known, value in (("theta", found.theta_rad), ("z", found.z_um)):
        assert value is None or known in routine.provides, label
    # no routine answers with what is beyond any search
    away = math.hypot(found.column - target.column, found.row - target.row)
    assert away <= 2 * target.search_px + 10, label


@every_pair
def test_the_work_is_predicted_from_artifact_and_pixels(
    name: str, kind: TargetKind
) -> None:
    artifact, routine = prepared(name, kind), load(name)
    if isinstance(artifact, Failure):
        return
    few, many = (routine.cost(artifact, n) for n in (10_000, 300_000))
    assert 0 < few <= many < 1e4
    assert routine.cost(artifact, 10_000) == few


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_a_routine_can_be_prepared_for_one_of_its_kinds(name: str) -> None:
    found = (prepared(name, kind) for kind in load(name).kinds)
    assert any(isinstance(artifact, Artifact) for artifact in found)


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_preparing_twice_is_preparing_once(name: str) -> None:
    kind = load(name).kinds[0]
    first, again = (
        prepared(name, kind),
        load(name).prepare(render(kind), look(kind).target),
    )
    if isinstance(first, Failure) or isinstance(again, Failure):
        assert first == again
        return
    assert first.parameters == again.parameters
    assert first.arrays.keys() == again.arrays.keys()
    for key, value in first.arrays.items():
        assert value.tobytes() == again.arrays[key].tobytes()
