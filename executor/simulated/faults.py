"""What can be made to go wrong in the simulated cell, by name, and how it must end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

# what a look at something wrong may end in; `verify` calls what it does not see MP850
_LOOK = ("MP820", "MP821", "MP822", "MP823", "MP825", "MP826", "MP850")
_SERVO = ("MP830", "MP831", "MP832")
# the probe; a first look may not know what it sees in a mirror
_TWISTED = ("MP833", "MP835", "MP820", "MP821")


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: what happens, and the codes one of which a run must end in.

    `codes` are for a fault that begins in some step, `from_start` for one that is there
    before the first motion by camera; () if that makes no difference. A run that
    `may_stand` it may also end well: then the part is truly seated. What is `lasting`
    is there from the start on or not at all.
    """

    what: str
    codes: tuple[str, ...]
    may_stand: bool = False
    from_start: tuple[str, ...] = ()
    lasting: bool = False


_AXIS = {
    "axis_raises": Fault("an axis group refuses a motion with an error", ("MP841",)),
    "axis_hangs": Fault("a moving axis group does not answer", ("MP844",)),
    "axis_never_ready": Fault("a motion is never reported as ended", ("MP845",)),
    "axis_short": Fault("a motion ends half way and says it is done", ("MP845",)),
    # a motion shorter than the window that stalls is one that never ends
    "axis_stalls": Fault(
        "a motion stops half way, still under way", ("MP846", "MP845")
    ),
    # it may leave the limits before it is seen to go the wrong way
    "axis_wrong_way": Fault("an axis runs away from its target", ("MP846", "MP840")),
    "axis_slips": Fault("an axis that was not told to moves along", ("MP846",)),
    "axis_nan": Fault("the reading of a moving axis is nan", ("MP847",)),
}
_JAWS = {
    "jaws_raise": Fault("the jaws refuse a motion with an error", ("MP841",)),
    "jaws_hang": Fault("the moving jaws do not answer", ("MP844",)),
    "jaws_stuck": Fault(
        "the jaws stay where they are and say they are done", ("MP849",)
    ),
    "jaws_nan": Fault("the reading of the moving jaws is nan", ("MP847",)),
}
_OPTICS = {
    "lens_raises": Fault("zoom or focus refuse a motion with an error", ("MP841",)),
    "lens_hangs": Fault("the moving lens does not answer", ("MP844",)),
    "lens_stuck": Fault("zoom or focus never report an end", ("MP845",)),
    "lens_nan": Fault("the reading of the moving lens is nan", ("MP847",)),
    "camera_raises": Fault("the camera fails with an error", ("MP841",)),
    "camera_hangs": Fault("the camera does not answer", ("MP844",)),
    "dropped_frames": Fault("no frame comes", ("MP848",)),
    "stale_frames": Fault(
        "every frame was exposed before the motion ended", ("MP848",)
    ),
    "short_frames": Fault("a frame lacks its last row", ("MP841",)),
    "light_out": Fault("the light is out", _LOOK),
    "uneven_light": Fault(
        "the light changes by .7 across the field",
        (*_LOOK, "MP851", "MP853"),
        may_stand=True,
    ),
}
# Only a picture tells these: the probe; else a look's gates, or an alignment that does
# not end, or leads where something stands.
_LATER = (*_LOOK, *_SERVO, "MP836")
_GEOMETRY = {
    "mirror_camera": Fault(
        "the camera swaps left and right", _LATER, from_start=_TWISTED
    ),
    "swap_camera": Fault("the camera swaps x and y", _LATER, from_start=_TWISTED),
    "scale_camera": Fault(
        "the picture is 10 % too large",
        (*_LATER, "MP851"),
        from_start=("MP834", "MP835", "MP820", "MP821", "MP825"),
    ),
    "reversed_axis": Fault(
        "x of the stage goes the other way and reads as told",
        _LATER,
        from_start=_TWISTED,
    ),
    "no_part": Fault("the part is not there", _LOOK, lasting=True),
}
_CONTACT = {
    "stick": Fault("the released part follows a finger", ("MP850", "MP854")),
    "block": Fault(
        "the part comes to rest on its post", ("MP850", "MP851", "MP852", "MP853")
    ),
}

FAULTS: Mapping[str, Fault] = {**_AXIS, **_JAWS, **_OPTICS, **_GEOMETRY, **_CONTACT}


class Faults:
    """The faults of one cell: `NAME` from the start on, `NAME@STEP` in that step only.

    Raises
    ------
    ValueError
        If a name is not one of `FAULTS`, or one of a lasting fault has a step.
    """

    def __init__(self, asked: Iterable[str] = ()) -> None:
        self.asked = tuple(dict.fromkeys(asked))
        self._step = ""
        self._met: set[str] = set()  # of `asked`
        for entry in self.asked:
            name, at, step = entry.partition("@")
            if at and not step:
                raise ValueError(f"{entry!r} names no step after the @")
            if name not in FAULTS:
                known = ", ".join(sorted(FAULTS))
                raise ValueError(f"no fault is called {name!r}; known: {known}")
            if step and FAULTS[name].lasting:
                raise ValueError(f"{entry!r} names a step: {name} lasts the whole run")

    def enter(self, step: str) -> None:
        """Say which step runs now."""
        self._step = step

    def on(self, name: str) -> bool:
        """Return whether a fault is at work now; if so, what asks has met it."""
        if name not in FAULTS:
            raise ValueError(f"no fault is called {name!r}")
        now = {name, f"{name}@{self._step}"}.intersection(self.asked)
        self._met |= now
        return bool(now)

    @property
    def idle(self) -> tuple[str, ...]:
        """Return the entries of `asked` that nothing has met so far."""
        return tuple(entry for entry in self.asked if entry not in self._met)
