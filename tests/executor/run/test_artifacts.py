"""Routines on numbers and arrays of a plan folder that was changed."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.artifacts import _read, answer_of
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Measurement,
    TargetKind,
)
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.plan import RoutineUse
from tests.featuresel.routines.test_contract import prepared, render, start

VALUES = (0.0, -1.0, 0.5)
MOST = 30  # ways to spoil a routine that are tried: some have 200


def spoilt(good: Artifact) -> Iterator[tuple[str, Artifact]]:
    """Yield an artifact with one number or array of another kind, or none."""
    numbers, arrays = dict(good.parameters), dict(good.arrays)
    yield "no numbers", replace(good, parameters={})
    yield "no arrays", replace(good, arrays={})
    for name in numbers:
        others = {k: v for k, v in numbers.items() if k != name}
        yield f"{name} is missing", replace(good, parameters=others)
        for value in VALUES:
            changed = {**numbers, name: value}
            yield f"{name} is {value}", replace(good, parameters=changed)
    for name, array in arrays.items():
        rest = {k: v for k, v in arrays.items() if k != name}
        yield f"{name} is missing", replace(good, arrays=rest)
        for how, other in (
            ("empty", array[:0]),
            ("flat", array.reshape(-1)),
            ("nan", np.full_like(array, np.nan)),
            ("text", np.full(array.shape, "x")),
            ("a number", np.array(1.0, np.float32)),
        ):
            yield f"{name} is {how}", replace(good, arrays={**rest, name: other})


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_a_spoilt_routine_answers_or_has_a_code(name: str) -> None:
    kind, good = next(
        (kind, found)
        for kind in load(name).kinds
        if isinstance(found := prepared(name, kind), Artifact)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numpy, about absurd numbers
        cases = [artifact for _, artifact in spoilt(good)]
        some = cases[:: 1 + len(cases) // MOST]
        told = {told_by(name, kind, artifact) for artifact in some}
    # nothing can be measured with no numbers at all
    assert {"MP803"} <= told <= {"MP803", "answered"}


def told_by(name: str, kind: TargetKind, artifact: Artifact) -> str:
    """Return whether a routine answers, or with which code it ends."""
    image = image_of(kind)
    try:
        found = answer_of(image, [(name, artifact)], start(kind))
    except ExecutorError as error:
        return error.code
    return "answered" if isinstance(found, Measurement | Failure) else repr(found)


@cache
def image_of(kind: TargetKind) -> FloatArray:
    """Return a picture of the target a little off its place."""
    return render(kind)(dx_um=0.4, dy_um=-0.3)


@pytest.mark.parametrize("value", [None, "1", [], {}, True, float("nan"), 10**400])
def test_a_number_of_another_kind_is_no_plan(value: object) -> None:
    data = {"id": "otsu", "version": "1", "parameters": {"a": value}, "arrays": None}
    with pytest.raises(CodecError, match=r"parameters\.a"):
        from_data(RoutineUse, data)


def test_a_damaged_file_of_arrays_has_a_code(tmp_path: Path) -> None:
    """Numpy lets through what zip, zlib and tokenize raise."""
    use = RoutineUse(id="edge", version="1", parameters={}, arrays="a.npz")
    path = tmp_path / "a.npz"
    np.savez_compressed(path, edge=np.arange(64.0))
    good = path.read_bytes()
    assert list(_read(use, tmp_path, hashlib.sha256()).arrays) == ["edge"]
    with io.BytesIO() as plain:
        np.save(plain, np.arange(3.0))
        spoilt = [plain.getvalue(), b"", good[:99]]
    for at in [*range(64), *range(len(good) - 64, len(good))]:
        spoilt += [good[:at] + bytes([byte]) + good[at + 1 :] for byte in (99, 255)]
    told = set()
    for data in spoilt:
        path.write_bytes(data)
        try:
            told |= set(_read(use, tmp_path, hashlib.sha256()).arrays)
        except ExecutorError as error:
            told.add(error.code)
    assert "MP803" in told
