"""Progress of a compile: one line that says how far it has come, and what is left."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TextIO

from microplan.schemas.page.console import is_terminal, redraw, tell

if TYPE_CHECKING:
    from microplan.planner.looks.progress.work import CompileProgress
    from microplan.planner.store.store import Store

REDRAWN_S = 0.1  # at least between two lines on a terminal
LINES_S = 10.0  # and elsewhere: a shorter compile has none there
# Before these a rate says little: looks differ by a factor of three.
KNOWN_S, KNOWN_SHARE = 5.0, 0.05
USUAL = 80  # columns of what does not say how many it has
_BAR = 10, 40  # columns of a bar, least and most


def columns(stream: TextIO | None) -> int | None:
    """Return the width of the terminal that a stream is read by, None if it is none."""
    if stream is None or not is_terminal(stream):
        return None
    try:
        return os.get_terminal_size(stream.fileno()).columns or USUAL
    except (OSError, ValueError):
        return USUAL


@dataclass(slots=True)
class Pace:
    """How fast images are made: of all looks so far, and of the present one.

    Images of one look may take several times as long as those of another.
    """

    _look: str = ""
    _since_s: float = 0.0  # when the present look was begun
    _made: float = 0.0  # of it by then, by another process

    def left_s(self, reached: CompileProgress, spent_s: float) -> float | None:
        """Return the time left, s; None before enough is known.

        What is left of the present look is taken at its own pace once that is known,
        all else at that of all.
        """
        if reached.look != self._look:
            self._look, self._since_s = reached.look, spent_s
            self._made = reached.here.made
        if spent_s < KNOWN_S or share(reached) < KNOWN_SHARE:
            return None
        each_s = own_s = spent_s / reached.all.made
        made, here_s = reached.here.made - self._made, spent_s - self._since_s
        if here_s >= KNOWN_S and made > KNOWN_SHARE * reached.here.needed:
            own_s = here_s / made
        here, others = reached.here.left, reached.all.left - reached.here.left
        return own_s * here + each_s * others


@dataclass(slots=True, kw_only=True)
class Progress:
    """Shows how far a compile has come: in place on a terminal, else line by line."""

    clock: Callable[[], float] = time.monotonic
    width: Callable[[], int | None] = lambda: columns(sys.stderr)
    last: CompileProgress | None = None
    pace: Pace = field(default_factory=Pace)
    _began_s: float = field(init=False)
    _shown_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._began_s = self._shown_s = self.clock()

    def __call__(self, reached: CompileProgress) -> None:
        """Show it, unless something was shown just now."""
        is_first = self.last is None
        self.last, now_s, width = reached, self.clock(), self.width()
        left_s = self.pace.left_s(reached, now_s - self._began_s)
        wait_s = LINES_S if width is None else REDRAWN_S
        if now_s - self._shown_s < wait_s and (width is None or not is_first):
            return
        self._shown_s = now_s
        said = words(reached, left_s)
        if width is None:
            tell(said)
        else:  # a full line would go on in the next
            redraw(barred(said, share(reached), width - 1), width - 1)

    def clear(self) -> None:
        """Leave nothing on a terminal."""
        width = self.width()
        if self.last is not None and width is not None:
            redraw("", width - 1)


def share(reached: CompileProgress) -> float:
    """Return the share of the work known that is done, 0..1; 0 if none is known."""
    whole = reached.all
    return min(whole.made / whole.needed, 1.0) if whole.needed > 0 else 0.0


def words(reached: CompileProgress, left_s: float | None) -> str:
    """Return what is worked on, how much of all is done, and the time left."""
    stage = f", {reached.stage}" if reached.stage else ""
    steps = f"{reached.steps} of {reached.all_steps} steps"
    done = f"{min(math.floor(100 * share(reached)), 99)} %"  # there is a step left
    said = f"compiling {reached.step}{stage}: {steps}, {done}"
    return said if left_s is None else f"{said}, {duration(left_s)} left"


def duration(time_s: float) -> str:
    """Return a time that is known roughly."""
    if time_s < 60:
        return f"about {max(5 * math.ceil(time_s / 5), 5)} s"
    minutes = math.ceil(time_s / 60)
    if minutes < 90:
        return f"about {minutes} min"
    return f"about {math.ceil(time_s / 3600)} h"


def barred(said: str, done: float, width: int) -> str:
    """Return a line with a bar where there is room, cut where there is none."""
    least, most = _BAR
    room = min(width - len(said) - 3, most)
    if room < least:
        return said[:width]
    full = math.floor(done * room)
    return f"{said} [{'#' * full}{'.' * (room - full)}]"


def kept_words(last: CompileProgress | None, store: Store | None) -> str:
    """Return what a compile that is stopped leaves for the next one."""
    if last is None:
        return "nothing was computed yet"
    if store is None:
        return "nothing is kept: --no-cache"
    if not store.folder.is_dir():
        return f"nothing is kept: {store.folder} cannot be written"
    if not last.steps:
        return "nothing of use is kept yet"
    return (
        f"kept: {last.steps} of {last.all_steps} steps; "
        "the same command goes on from there"
    )
