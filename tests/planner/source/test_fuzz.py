"""A few spoilt and random inputs; `python -m benchmarks.robustness.fuzz` tries many."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.planner.drawings.dxf_text import binary
from tests.planner.source.fuzzing import (
    DXF_TEXTS,
    GDS_FILES,
    judge_dxf,
    judge_gds,
    judge_task,
    random_dxf,
    random_gds,
    spoilt_bytes,
    spoilt_dxf,
    spoilt_gds,
    spoilt_yaml,
)

# the same each time: what is found by chance belongs into a test of its own
quick = settings(max_examples=40, deadline=None, derandomize=True, database=None)
_DXF_FILES = [*(text.encode() for text in DXF_TEXTS), binary(DXF_TEXTS[0], short=False)]


@quick
@given(data=st.one_of(spoilt_dxf(), spoilt_bytes(st.sampled_from(_DXF_FILES))))
def test_a_spoilt_dxf_file_gives_an_outline_or_a_reason(data: bytes) -> None:
    judge_dxf(data)


@settings(quick, max_examples=20)
@given(data=random_dxf())
def test_random_entities_give_an_outline_or_a_reason(data: bytes) -> None:
    judge_dxf(data)


@quick
@given(data=st.one_of(spoilt_gds(), spoilt_bytes(st.sampled_from(GDS_FILES))))
def test_a_spoilt_gdsii_file_gives_an_outline_or_a_reason(data: bytes) -> None:
    judge_gds(data)


@quick
@given(data=random_gds())
def test_random_shapes_give_an_outline_or_a_reason(data: bytes) -> None:
    judge_gds(data)


@settings(quick, max_examples=15)
@given(spoilt=spoilt_yaml())
def test_a_spoilt_task_gives_a_task_or_a_reason(spoilt: tuple[str, str]) -> None:
    judge_task(*spoilt)
