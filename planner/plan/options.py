"""What the command line may override of a compile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.presets import Effort, Preset, Sketch

if TYPE_CHECKING:  # it loads what an unchanged task does not need
    from microplan.planner.looks.progress.work import CompileProgress


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options that override the task's own; None leaves it to the task."""

    preset: Preset | Sketch | None = None
    effort: Effort | None = None  # None: the preset's
    max_image_error: float | None = None
    confidence: float | None = None  # that P(success) meets the goal; None: it alone
    jobs: int = 1
    scheduler: str | None = None  # of a Dask cluster; None: processes here
    progress: Callable[[CompileProgress], None] = lambda _reached: None
    memo: Memo = EVERY_TIME  # what is kept between compiles; by itself nothing
