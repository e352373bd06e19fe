"""Values as bytes and back."""

from __future__ import annotations

import math
import struct
from collections import OrderedDict
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.outline.outline import Arc, Outline, Ring
from microplan.planner.store.canonical import CanonicalError, decode, encode
from microplan.schemas.pose import Pose

SIMPLE = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.binary(max_size=9),
    st.text(st.characters(exclude_categories=[]), max_size=9),
)  # fmt: skip
FINITE = st.floats(allow_nan=False, allow_infinity=False)
POSES = st.builds(Pose, x_um=FINITE, y_um=FINITE, theta_rad=st.floats(-3, 3))
KEYS = st.one_of(st.integers(), st.text(max_size=4), st.tuples(st.text(max_size=2)))
VALUES = st.recursive(
    st.one_of(SIMPLE, POSES),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.lists(inner, max_size=4).map(tuple),
        st.dictionaries(KEYS, inner, max_size=4),
        st.frozensets(st.one_of(st.integers(), st.text(max_size=3)), max_size=4),
    ),
    max_leaves=20,
)


def same(one: Any, other: Any) -> bool:
    """Return whether two values are alike, nan and the sign of 0 included."""
    if type(one) is not type(other):
        return False
    if isinstance(one, float):
        return struct.pack("d", one) == struct.pack("d", other)
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return same([*one.items()], [*other.items()])
    if isinstance(one, Pose):
        return all(same(getattr(one, n), getattr(other, n)) for n in one.__slots__)
    return bool(one == other)


@given(VALUES)
def test_a_value_comes_back_as_it_was(value: Any) -> None:
    assert same(decode(encode(value)), value)


@given(VALUES, VALUES)
def test_different_values_have_different_bytes(one: Any, other: Any) -> None:
    assert (encode(one) == encode(other)) == same(one, other)


@pytest.mark.parametrize(
    "array",
    [np.zeros((0, 3)), np.arange(6, dtype="<i2").reshape(2, 3), np.array(1.5),
     np.array([True, False]), np.arange(8, dtype=np.float32)[::2],
     np.asfortranarray(np.arange(6.0).reshape(2, 3)), np.array([1 + 2j])],
)  # fmt: skip
def test_arrays_keep_type_shape_and_numbers(array: npt.NDArray[Any]) -> None:
    found = decode(encode({"a": array}))["a"]
    assert found.dtype == array.dtype
    np.testing.assert_array_equal(found, array, strict=True)
    assert not found.flags.writeable


def test_an_outline_comes_back() -> None:
    arc = Arc(center=(1.0, 2.0), radius_um=3.0, start_rad=0.0, sweep_rad=math.tau)
    outline = Outline(rings=(Ring(edges=(arc,)),))
    assert decode(encode(outline)) == outline
    moved = replace(arc, radius_um=math.nextafter(3.0, 4.0))
    assert encode(Outline(rings=(Ring(edges=(moved,)),))) != encode(outline)


def test_numbers_of_numpy_are_numbers() -> None:
    assert encode((np.float64(1.5), np.int32(2), np.True_)) == encode((1.5, 2, True))


@dataclass(frozen=True)
class Foreign:
    """A class of nobody's."""

    x: int = 1


@pytest.mark.parametrize(
    "value",
    [Foreign(), object(), {1, 2}, Fraction(1, 2), len, Pose, np.array([None]),
     np.array(["a"]), bytearray(b"x"), [object()]],
)  # fmt: skip
def test_what_has_no_bytes_is_refused(value: Any) -> None:
    with pytest.raises(CanonicalError):
        encode(value)


def test_what_holds_itself_is_refused() -> None:
    loop: list[Any] = []
    loop.append(loop)
    with pytest.raises(CanonicalError, match="deeper"):
        encode(loop)


@pytest.mark.parametrize(
    "name",
    ["os:system", "subprocess:Popen", "microplan.planner.cli.main:main",
     "builtins:eval", "microplan.planner.store.store:Path",
     "microplan.schemas.plan:nothing", "microplan.none:X", "planner.none:X", ":", ""],
)  # fmt: skip
def test_bytes_build_nothing_but_our_values(name: str) -> None:
    data = encode(Pose(x_um=0.0, y_um=0.0))
    ours = b"microplan.schemas.pose:Pose"
    other = name.encode()
    head = b"D" + struct.pack("<Q", len(ours)) + ours
    assert data.startswith(head)
    forged = b"D" + struct.pack("<Q", len(other)) + other + data[len(head) :]
    with pytest.raises(CanonicalError):
        decode(forged)


@given(VALUES, st.data())
def test_spoilt_bytes_give_a_value_or_an_error(value: Any, data: st.DataObject) -> None:
    """Nothing else happens, and little memory is asked for."""
    spoilt = bytearray(encode(value))
    at = data.draw(st.integers(0, len(spoilt) - 1))
    spoilt[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(spoilt)))
    for tried in (bytes(spoilt), bytes(spoilt[:cut]), bytes(spoilt) + b"N"):
        try:
            found = decode(tried)
        except CanonicalError:
            continue
        assert encode(found)  # nothing that could not have been kept


def test_order_of_keys_is_kept() -> None:
    one = OrderedDict([("b", 1), ("a", 2)])
    assert list(decode(encode(one))) == ["b", "a"]


def test_equal_outlines_have_equal_bytes_however_often_they_are_asked_for() -> None:
    arc = Arc(center=(0.0, 0.0), radius_um=5.0, start_rad=0.0, sweep_rad=2 * math.pi)
    one, same_one = (
        Outline(rings=(Ring(edges=(arc,)),)),
        Outline(rings=(Ring(edges=(replace(arc),)),)),
    )
    other = Outline(rings=(Ring(edges=(replace(arc, radius_um=5.5),)),))
    first = encode((one, one, {"deeper": [one]}))
    assert encode((one, same_one, {"deeper": [one]})) == first
    assert encode((one, other, {"deeper": [one]})) != first
    assert decode(first) == (one, one, {"deeper": [one]})
    for radius_um in range(1, 2000):  # each may get the place of one before
        each = Outline(rings=(Ring(edges=(replace(arc, radius_um=float(radius_um)),)),))
        assert decode(encode(each)) == each
