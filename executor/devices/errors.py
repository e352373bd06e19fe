"""Error codes of the executor, each with its title, its exit status."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

DONE, FAILED, BAD_INPUT, MACHINE, STOPPED, BUG = 0, 1, 2, 3, 4, 70

# code -> (title, exit status); each has a page in docs/diagnostics/, never reused
CODES: Mapping[str, tuple[str, int]] = {
    "MP801": ("the plan is infeasible", FAILED),
    "MP802": ("the plan cannot be read", BAD_INPUT),
    "MP803": ("a file of the plan folder is missing or damaged", BAD_INPUT),
    "MP804": ("the plan's run cannot be set up as asked", BAD_INPUT),
    "MP805": ("the camera is not the one the plan needs", MACHINE),
    "MP806": ("the microscope does not reach what the plan needs", MACHINE),
    "MP807": ("the jaws do not reach what the plan needs", MACHINE),
    "MP808": ("the axes do not reach what the plan needs", MACHINE),
    "MP809": ("the stage turns about another point", MACHINE),
    "MP810": ("the plan needs a routine that is not installed", MACHINE),
    "MP811": ("the station is not at the plan's start", MACHINE),
    "MP812": ("the station file cannot be understood", BAD_INPUT),
    "MP813": ("a driver cannot be loaded", BAD_INPUT),
    "MP814": ("the station's calibration does not fit the plan", MACHINE),
    "MP815": ("the plan moves farther or faster than the station allows", MACHINE),
    "MP816": ("the simulated cell has no such light", MACHINE),
    "MP817": ("the plan is a sketch", FAILED),
    "MP820": ("a target was not found", FAILED),
    "MP821": ("a measurement scored too low", FAILED),
    "MP822": ("a target was found too far from where it was expected", FAILED),
    "MP823": ("a target was found turned too far", FAILED),
    "MP824": ("an angle is needed and is not known", FAILED),
    "MP825": ("a measurement is too uncertain", FAILED),
    "MP826": ("the features of one look disagree", FAILED),
    "MP830": ("the alignment did not reach its tolerance", FAILED),
    "MP831": ("the alignment diverged", MACHINE),
    "MP832": ("a correction was larger than allowed", MACHINE),
    "MP833": ("the image does not follow the axes", MACHINE),
    "MP834": ("the image is out of scale", MACHINE),
    "MP835": ("the target was lost by the probe", MACHINE),
    "MP836": ("a motion would bring two bodies together", MACHINE),
    "MP837": ("a servo gain is not stable on this station", MACHINE),
    "MP840": ("an axis was sent beyond its limits", MACHINE),
    "MP841": ("a device failed", MACHINE),
    "MP842": ("the fingers would come too close to the stage", MACHINE),
    "MP843": ("a move is larger or faster than its phase allows", MACHINE),
    "MP844": ("a device does not answer", MACHINE),
    "MP845": ("a motion did not end where and when it should", MACHINE),
    "MP846": ("an axis does not follow its order", MACHINE),
    "MP847": ("a number is not finite", MACHINE),
    "MP848": ("no fresh frame came", MACHINE),
    "MP849": ("the jaws did not move as told", MACHINE),
    "MP850": ("verify: nothing was found where the part should sit", FAILED),
    "MP851": ("verify: the part is off its seat", FAILED),
    "MP852": ("verify: the part is at the wrong height", FAILED),
    "MP853": ("verify: the height could not be measured", FAILED),
    "MP854": ("verify: the tool may still hold something", FAILED),
    "MP855": ("the plan acts but never verifies", FAILED),
    "MP856": ("verify: the part is turned against its seat", FAILED),
    "MP860": ("the operator stopped the run", STOPPED),
    "MP861": ("another executor is at work", MACHINE),
    "MP862": ("the run folder holds a run that did not end", BAD_INPUT),
    "MP863": ("the run's journal cannot be written", MACHINE),
    "MP864": ("an action that must not be done twice was interrupted", STOPPED),
    "MP865": ("the station does not stand where the journal left it", MACHINE),
    "MP866": ("plan, station or devices are not those the run began with", BAD_INPUT),
    "MP867": ("the run's journal is damaged", BAD_INPUT),
    "MP868": ("there is no run to resume", BAD_INPUT),
    "MP876": ("the replay gives other commands than the run", FAILED),
    "MP877": ("a record cannot be replayed", BAD_INPUT),
    "MP878": ("pictures of a look cannot be used", BAD_INPUT),
    "MP879": ("runs cannot be compared", BAD_INPUT),
}


class ExecutorError(Exception):
    """A run, or its start, that cannot go on.

    Parameters
    ----------
    code : str
        A key of `CODES`.
    message : str
        The value, the limit, the unit and the object.
    cause : str
        A routine's own failure code, "" if there is none.
    place : path, optional
        The file or folder that is at fault; None: the plan.
    others : sequence of ExecutorError
        What else is wrong, where all mistakes of a file are told at once.
    """

    def __init__(
        self,
        code: str,
        message: str,
        *,
        cause: str = "",
        place: str | Path | None = None,
        others: Sequence[ExecutorError] = (),
    ) -> None:
        if code not in CODES:
            raise ValueError(f"unknown code {code!r}")
        super().__init__(message)
        self.code = code
        self.message = message
        self.cause = cause
        self.place = place
        self.others = tuple(others)

    def append(self, more: str) -> None:
        """Add to the message what became known later."""
        self.message = f"{self.message}; {more}"
        self.args = (self.message,)

    @property
    def exit_status(self) -> int:
        """Return the exit status that goes with the code."""
        return CODES[self.code][1]


@contextmanager
def failing(
    code: str, path: Path, kinds: tuple[type[Exception], ...] = (OSError,)
) -> Iterator[None]:
    """Raise `code` about a file or folder if the work inside raises one of `kinds`."""
    try:
        yield
    except kinds as error:
        raise ExecutorError(code, f"{path}: {why(error)}", place=path) from error


def meant(word: str, known: Iterable[str]) -> str:
    """Return ", did you mean 'x'?" for the known word nearest to `word`, or ""."""
    near = difflib.get_close_matches(word, sorted(known), n=1, cutoff=0.6)
    return f", did you mean {near[0]!r}?" if near else ""


def why(error: Exception) -> str:
    """Return the message of an exception; of the system's, without number and path."""
    return (error.strerror if isinstance(error, OSError) else "") or str(error)
