"""What the run report says of times: as predicted, and why some are not."""

from __future__ import annotations

from microplan.executor.analysis.run_artifacts import Row, RunArtifacts, real, text
from microplan.schemas.files.times import JAWS, PROBE
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import number, seconds


def predicted(left: RunArtifacts) -> Element | None:
    """Return how long what was predicted took, and what was not predicted."""
    known = [
        (took, expected)
        for step in left.steps
        if (took := real(step, "time_s")) is not None
        and (expected := real(step, "expected_s")) is not None
    ]
    if not known:
        return None
    took, expected = (sum(column) for column in zip(*known, strict=True))
    rest: dict[str, list[str]] = {}
    for step in left.steps:
        if real(step, "expected_s") is None:
            rest.setdefault(_unpredicted(left, step), []).append(str(step["id"]))
    others = "; ".join(
        ", ".join(names) + (f" ({why})" if why else "") for why, names in rest.items()
    )
    said = f"{seconds(took)} of it predicted as {seconds(expected)}"
    return el("small", f"{said}; not predicted: {others}" if others else said)


def times(left: RunArtifacts, step: Row) -> str:
    """Return how long a step took and should have, or why nothing says so."""
    expected = real(step, "expected_s")
    if expected is not None:
        said = seconds(expected)
    else:
        why = _unpredicted(left, step)
        said = f"not predicted ({why})" if why else "not predicted"
    return pair(seconds(real(step, "time_s")), said)


def pair(actual: str, predicted: str) -> str:
    """Return what was and what should have been, one dash if there is neither."""
    nothing = number(None)
    if actual == nothing and predicted == nothing:
        return nothing
    return f"{actual} / {predicted}"


def _unpredicted(left: RunArtifacts, step: Row) -> str:
    """Return why no plan tells how long a step takes, "" if nobody knows."""
    if text(step, "verb") in ("grasp", "release"):
        return JAWS
    name = str(step["id"])
    events = (row for row in left.events if row.get("step") == name)
    probed = any(text(row, "event").startswith("probe") for row in events)
    return PROBE if probed else ""
