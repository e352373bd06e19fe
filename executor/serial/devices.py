"""Driver of a controller on a serial line (lens, jaws), as a hub of a station file."""

from __future__ import annotations

import math
from collections.abc import Sequence

from microplan.executor.serial.link import ANSWER_S, Link, Port

Interval = tuple[float, float]
_Name = tuple[str, str]  # model and serial number
ZOOM, FOCUS, JAWS = "zoom", "focus", "jaws"  # what the controller calls its axes


class Controller:
    """A controller; `lens` and `jaws` are its parts.

    Parameters
    ----------
    port : str
        The port's path, "/dev/ttyUSB0".
    magnification, focus_um, opening_um : pair of float
        Limits; the controller has its own, which may be wider.
    baud : int
        Bits per second.
    answer_s : float
        How long it may take for an answer; a question is asked three times.

    Raises
    ------
    OSError
        If the port cannot be opened.
    ExecutorError
        MP844 if there is no answer.
    ValueError
        If an option makes no sense, or the answer to `id` is not two words.
    """

    def __init__(
        self,
        *,
        port: str,
        magnification: Sequence[float],
        focus_um: Sequence[float],
        opening_um: Sequence[float],
        baud: int = 115200,
        answer_s: float = ANSWER_S,
    ) -> None:
        limits = {
            ZOOM: _interval("magnification", magnification),
            FOCUS: _interval("focus_um", focus_um),
            JAWS: _interval("opening_um", opening_um),
        }
        self._link = link = Link(Port(port, baud), answer_s=answer_s)
        try:
            name = _two("id", link.ask("id"))
        except BaseException:
            link.close()
            raise
        axes = {axis: _Axis(link, axis, limits[axis]) for axis in limits}
        self.lens = SerialLens(link, axes[ZOOM], axes[FOCUS], name)
        self.jaws = SerialGripper(link, axes[JAWS], name)

    def close(self) -> None:
        """Close the port."""
        self._link.close()


class _Axis:
    """One axis of the controller."""

    def __init__(self, link: Link, name: str, limits: Interval) -> None:
        self._link, self._name, self._limits = link, name, limits

    def go(self, value: float) -> None:
        """Begin to go; ValueError if it is not finite or beyond the limits."""
        low, high = self._limits
        slack = 1e-5 * max(abs(low), abs(high))  # a plan's numbers carry six digits
        if not low - slack <= value <= high + slack:  # also refuses nan
            raise ValueError(f"{self._name} = {value:.6g} is outside {low:g}..{high:g}")
        self._link.ask("go", self._name, f"{value:.6f}")

    def state(self) -> tuple[float, bool]:
        """Return its position, and whether it moves."""
        value, moving = _two(self._name, self._link.ask("at", self._name))
        if moving not in ("0", "1"):
            raise ValueError(f"{self._name}: moving is {moving!r}, not 0 or 1")
        return (float(value), moving == "1")


class SerialLens:
    """Zoom and focus of the controller."""

    def __init__(self, link: Link, zoom: _Axis, focus: _Axis, name: _Name) -> None:
        self._link, self._zoom, self._focus = link, zoom, focus
        self.model, self.serial = name[0], f"{name[1]} lens"

    def start_magnification(self, magnification: float) -> None:
        """Begin to zoom; see `microplan.executor.devices.drivers.Lens`."""
        self._zoom.go(magnification)

    def start_focus_um(self, focus_um: float) -> None:
        """Begin to focus; see `microplan.executor.devices.drivers.Lens`."""
        self._focus.go(focus_um)

    def reading(self) -> tuple[float, float]:
        """Return magnification and focus, um."""
        return (self._zoom.state()[0], self._focus.state()[0])

    def moving(self) -> bool:
        """Return whether zoom or focus move."""
        return self._zoom.state()[1] or self._focus.state()[1]

    def stop(self) -> None:
        """Stop both, by one line."""
        self._link.ask("stop", ZOOM, FOCUS)


class SerialGripper:
    """Jaws of the controller."""

    def __init__(self, link: Link, axis: _Axis, name: _Name) -> None:
        self._link, self._axis = link, axis
        self.model, self.serial = name[0], f"{name[1]} jaws"

    def start(self, opening_um: float) -> None:
        """Begin to open or close; see `microplan.executor.devices.drivers.Gripper`."""
        self._axis.go(opening_um)

    def reading(self) -> float:
        """Return the opening, um."""
        return self._axis.state()[0]

    def moving(self) -> bool:
        """Return whether the jaws move."""
        return self._axis.state()[1]

    def stop(self) -> None:
        """Stop."""
        self._link.ask("stop", JAWS)


def _two(what: str, words: tuple[str, ...]) -> tuple[str, str]:
    """Return two words; ValueError if there are not two."""
    if len(words) != 2:
        raise ValueError(f"{what}: the answer has {len(words)} words, not 2")
    return (words[0], words[1])


def _interval(name: str, pair: Sequence[float]) -> Interval:
    """Return a pair of limits that rise."""
    found = [float(v) for v in pair]
    if len(found) != 2 or not all(map(math.isfinite, found)) or found[0] >= found[1]:
        raise ValueError(f"{name} = {list(pair)}: two finite numbers that rise")
    return (found[0], found[1])
