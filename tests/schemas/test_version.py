"""Which versions of a format a reader takes."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.schemas.version import Version, VersionError, check, is_newer

NUMBERS = st.integers(0, 999_999)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def test_the_major_alone_decides(a: int, b: int, c: int, d: int) -> None:
    text, ours = f"{a}.{b}", f"{c}.{d}"
    assert str(Version.of(text)) == text
    assert is_newer(text, ours) == ((a, b) > (c, d))
    if a == c:
        check(text, ours)
        return
    with pytest.raises(VersionError, match="newer" if a > c else "older") as refused:
        check(text, ours)
    assert "compile the task again" in str(refused.value)


@pytest.mark.parametrize(
    "odd",
    [None, "", "2", "2.", ".3", "2.3.1", " 2.3", "2.3 ", "2.3\n", "02.3", "2.03",
     "-2.3", "+2.3", "2.-3", "2,3", "2.x", "v2.3", "2.3e1", "\u0662.3", "1e9.0",
     "2." + "9" * 7, "9" * 10_000 + ".0", 2.3, 2, -1, True, [2, 3], {"major": 2},
     float("nan")],
)  # fmt: skip
def test_what_is_no_version_is_refused(odd: Any) -> None:
    with pytest.raises(VersionError, match=r"major\.minor") as refused:
        check(odd, "2.3")
    assert len(str(refused.value)) < 200
