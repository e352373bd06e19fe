"""A compile's chunks replayed on more cores."""

from __future__ import annotations

import pytest

from benchmarks.compiling.cores import Chunks, Flow, longest_chain_s, replayed_s

FOUR = (1.0, 1.0, 1.0, 1.0)
# two looks begin ahead, the second's chunks are more urgent; the main flow waits
FLOWS: list[Flow] = [
    [0.5, 1, 2, 0.5],
    [1.0, Chunks(FOUR, 0.0)],
    [1.0, Chunks(FOUR, 1.0)],
]


@pytest.mark.parametrize(
    ("cores", "ends_s"),
    [
        (2, 0.5 + 1 + 8 + 0.5),  # one for all chunks
        (5, 0.5 + 1 + 1 + 1 + 0.5),  # the looks have their turns one after the other
        (100, 4.0),
    ],
)
def test_a_replay_keeps_who_waits_for_whom(cores: int, ends_s: float) -> None:
    assert replayed_s(FLOWS, cores) == pytest.approx(ends_s)


def test_the_longest_chain_waits_for_no_turn() -> None:
    assert longest_chain_s(FLOWS) == pytest.approx(1 + 1 + 0.5)


def test_what_ended_before_is_not_waited_for() -> None:
    flows: list[Flow] = [[1.0, Chunks((), 0.0), 1, 1, 1.0], [0.25]]
    assert replayed_s(flows, 2) == pytest.approx(2.25)
