"""An insertion's moves, and the way back from one that would hit something."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.run_context import Rig
from microplan.schemas.plan import AxisMove, InsertAction

# A move that is refused before it begins, by where things are: all devices are well.
IN_THE_WAY = "MP836"


def insert(rig: Rig, action: InsertAction, retreat: Sequence[AxisMove]) -> None:
    """Make an insertion's moves; if one of them is refused, go back by the others.

    Only what keep-out refuses is gone back from, while every device does as it is told.
    After any other fault the axes stay where they are. The jaws never move.

    Parameters
    ----------
    retreat : sequence of AxisMove
        The way back from the last move to the first; () to stay.

    Raises
    ------
    ExecutorError
        Of the move that failed; MP836 if it was in the way, also after the way back.
    """
    rig.phase = "insert"
    for made, move in enumerate(action.moves):
        try:
            rig.move(move, name_of(made))
        except ExecutorError as error:
            if error.code == IN_THE_WAY and len(retreat) == len(action.moves):
                _go_back(rig, retreat[len(retreat) - made :], error)
            raise


def name_of(number: int) -> str:
    """Return what the journal calls a move of an insertion, counted from 0."""
    return f"insert {number + 1}"


def _go_back(rig: Rig, moves: Sequence[AxisMove], why: ExecutorError) -> None:
    """Undo the moves that were made, as far as nothing is in the way."""
    rig.journal.write("retreat", why=str(why), moves=len(moves))
    rig.phase = "retreat"
    for left, move in enumerate(moves, start=1):
        # before it is: an executor that takes over here makes that move once more
        rig.intents.write("undone", name=name_of(len(moves) - left))
        try:
            rig.move(move)
        except ExecutorError as error:
            if error.code != IN_THE_WAY:
                raise
            why.append(f"the way back is blocked: {error.message}")
            return
    if moves:
        why.append("went back by the plan's retreat")
