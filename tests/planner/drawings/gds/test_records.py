"""Records of GDSII: reals by their published bytes, and what breaks the format."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.planner.drawings.gds.records import MAX_RECORDS, GdsError, real8, records
from tests.planner.drawings import gds_writer as gds

WHOLE = gds.library(gds.cell("TOP", gds.boundary(gds.SQUARE)))


def fault(data: bytes) -> GdsError:
    """Return why the records of a file cannot be read."""
    with pytest.raises(GdsError) as caught:
        list(records(data))
    return caught.value


@pytest.mark.parametrize(
    ("hexadecimal", "value"),
    [
        # Calma's manual: excess 64, base 16, a mantissa below 1
        ("4110000000000000", 1.0),
        ("4120000000000000", 2.0),
        ("C110000000000000", -1.0),
        ("4080000000000000", 0.5),
        ("425A000000000000", 90.0),
        ("3E4189374BC6A7F0", 1e-3),
        ("3944B82FA09B5A54", 1e-9),
        ("0000000000000000", 0.0),
        ("4110000000000001", 1.0),  # the last bits are beyond a float's
    ],
)
def test_reals_are_read_as_published(hexadecimal: str, value: float) -> None:
    assert real8(bytes.fromhex(hexadecimal)) == pytest.approx(value, rel=2.3e-16)


@given(st.floats(min_value=1e-70, max_value=1e70))
def test_a_float_written_is_the_float_read(value: float) -> None:
    assert real8(gds.real8(value)) == value  # 53 bits of 56, less up to 3 zeros
    assert real8(gds.real8(-value)) == -value


@given(st.binary(min_size=8, max_size=8))
def test_every_real_is_finite(body: bytes) -> None:
    assert math.isfinite(real8(body))


def test_records_tell_where_they_begin() -> None:
    found = list(records(WHOLE))
    assert [r.name for r in found[:4]] == ["HEADER", "BGNLIB", "LIBNAME", "UNITS"]
    assert found[-1].name == "ENDLIB"
    assert [r.offset for r in found[:3]] == [0, 6, 34]
    assert b"".join(WHOLE[r.offset : r.offset + 4] + r.body for r in found) == WHOLE


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (struct.pack(">HBB", 0, 0x0D, 2), "length is 0"),
        (struct.pack(">HBB", 2, 0x0D, 2), "length is 2"),
        (struct.pack(">HBB", 7, 0x0D, 2) + bytes(3), "length is 7"),
        (struct.pack(">HBB", 8, 0x0D, 2) + bytes(4), "4 bytes, 2 allowed"),
        (struct.pack(">HBB", 6, 0x0D, 3) + bytes(2), "data type 3, 2 is right"),
        (struct.pack(">HBB", 6, 0x7F, 2) + bytes(2), "0x7f is unknown"),
        (struct.pack(">HBB", 10, 0x10, 3) + bytes(6), "multiples of 8"),
        (struct.pack(">HBB", 60_004, 0x10, 3), "runs past the end"),
    ],
)
def test_a_broken_record_is_named_with_its_place(head: bytes, words: str) -> None:
    start = WHOLE.index(b"\x00\x04\x08\x00")  # BOUNDARY
    error = fault(WHOLE[: start + 4] + head)
    assert (error.code, error.offset) == ("MP230", start + 4)
    assert words in error.message


def test_only_zeros_may_follow_the_end() -> None:
    assert len(list(records(WHOLE + bytes(2048)))) == len(list(records(WHOLE)))
    error = fault(WHOLE + bytes(100) + b"\n")
    assert (error.code, error.offset) == ("MP230", len(WHOLE) + 100)


def test_a_flood_of_records_is_stopped() -> None:
    assert fault(gds.record(0x11, 0) * (MAX_RECORDS + 1)).code == "MP215"
