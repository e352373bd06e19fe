"""What no other reader of JSON would take is refused where it comes in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pytest

from microplan.schemas.codec import CodecError, from_data


@dataclass(frozen=True)
class Row:
    """One value of each kind."""

    name: str = ""
    count: int = 0
    sizes: Mapping[str, float] | None = None


@pytest.mark.parametrize(
    "data",
    [{"name": "a\ud800"}, {"count": 10**400}, {"count": -(1 << 63)},
     {"sizes": {"\udfff": 1.0}}, {"sizes": {"a": 10**400}}],
)  # fmt: skip
def test_halves_of_characters_and_endless_numbers_are_refused(data: Any) -> None:
    with pytest.raises(CodecError, match=r"^Row\."):
        from_data(Row, data)


def test_all_of_unicode_and_large_numbers_are_taken() -> None:
    data = {"name": "\u05d2\U0001f600\n", "count": (1 << 63) - 1, "sizes": {"\xb5": 1}}
    assert from_data(Row, data) == Row(
        "\u05d2\U0001f600\n", (1 << 63) - 1, {"\xb5": 1.0}
    )
