"""Calls are made once; another argument or another source is another call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from microplan.featuresel.trials.trial_cache import Looks
from microplan.planner.store import memo as memos
from microplan.planner.store.canonical import CanonicalError
from microplan.planner.store.memo import Memo, digest, source_files
from microplan.planner.store.store import Store
from microplan.schemas.pose import Pose

made: list[str] = []


def turned(
    pose: Pose,
    *,
    by_rad: float = 0.0,
    map: Callable[..., object] = map,  # noqa: A002 - as the functions call it
    looks: object = None,
) -> Pose:
    """Return a pose turned; its calls are counted."""
    made.append(f"{pose} {by_rad} {map is not None}")
    return Pose(x_um=pose.x_um, y_um=pose.y_um, theta_rad=pose.theta_rad + by_rad)


POSE = Pose(x_um=1.0, y_um=2.0)


@pytest.fixture
def memo(tmp_path: Path) -> Memo:
    made.clear()
    return Memo(Store(tmp_path))


def test_a_call_is_made_once(memo: Memo) -> None:
    first = memo.call(turned, POSE, by_rad=0.5)
    assert memo.call(turned, POSE, by_rad=0.5) == first == turned(POSE, by_rad=0.5)
    assert len(made) == 2  # the one above, and the comparison's own
    memo.call(turned, POSE, by_rad=0.25)
    memo.call(turned, Pose(x_um=1.0, y_um=2.5), by_rad=0.5)
    assert len(made) == 4


def length(far: float, pose: Pose) -> float:
    made.append(str(pose))
    return far + pose.x_um


def test_each_item_is_worked_on_once(memo: Memo) -> None:
    poses = [Pose(x_um=float(x), y_um=0.0) for x in range(4)]
    assert memo.each(length, 10.0, poses[1:3], map) == [11.0, 12.0]
    assert memo.each(length, 10.0, poses, map) == [10.0, 11.0, 12.0, 13.0]
    assert len(made) == 4
    assert memo.each(length, 20.0, poses[:1], map) == [20.0]
    assert Memo().each(length, 10.0, poses, map) == [10.0, 11.0, 12.0, 13.0]
    assert len(made) == 9


def test_how_work_is_spread_is_no_other_call(memo: Memo) -> None:
    memo.call(turned, POSE, map=map)
    memo.call(turned, POSE, map=lambda *_: ())
    memo.call(turned, POSE, looks=Looks())
    assert len(made) == 1
    with pytest.raises(CanonicalError):  # what is neither value nor known to be a cache
        memo.call(turned, POSE, looks=object())


def test_without_a_store_every_call_is_made() -> None:
    made.clear()
    for _ in range(2):
        assert Memo().call(turned, POSE) == POSE
    assert len(made) == 2


def test_other_sources_are_another_call(
    memo: Memo, monkeypatch: pytest.MonkeyPatch
) -> None:
    memo.call(turned, POSE)
    monkeypatch.setattr(memos, "sources", lambda: "changed")
    memo.call(turned, POSE)
    assert len(made) == 2


def test_a_result_of_unknown_form_is_computed_again(memo: Memo) -> None:
    assert memo.store is not None
    key = digest(f"{turned.__module__}:{turned.__qualname__}", (POSE,), {})
    memo.store.put(key, b"not a value")
    assert memo.call(turned, POSE) == POSE
    assert len(made) == 1


def test_the_sources_are_those_on_disk() -> None:
    assert memos.sources() == memos.sources()
    assert len(memos.sources()) == 64
    names = {file.relative_to(root).as_posix() for root, file in source_files()}
    assert {"plan.schema.json", "task.schema.json", "codec.py"} <= names
