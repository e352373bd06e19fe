"""Faults of the simulated cell by name: what happens, in which step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from microplan.executor.devices.errors import meant

FAULTS: Mapping[str, str] = {  # name -> what happens
    "axis_raises": "an axis group refuses a motion with an error",
    "axis_hangs": "a moving axis group does not answer",
    "axis_never_ready": "a motion is never reported as ended",
    "axis_short": "a motion ends half way and says it is done",
    "axis_stalls": "a motion stops half way, still under way",
    "axis_wrong_way": "an axis runs away from its target",
    "axis_slips": "an axis that was not told to moves along",
    "axis_nan": "the reading of a moving axis is nan",
    "jaws_raise": "the jaws refuse a motion with an error",
    "jaws_hang": "the moving jaws do not answer",
    "jaws_stuck": "the jaws stay where they are and say they are done",
    "jaws_nan": "the reading of the moving jaws is nan",
    "lens_raises": "zoom or focus refuse a motion with an error",
    "lens_hangs": "the moving lens does not answer",
    "lens_stuck": "zoom or focus never report an end",
    "lens_nan": "the reading of the moving lens is nan",
    "camera_raises": "the camera fails with an error",
    "camera_hangs": "the camera does not answer",
    "dropped_frames": "no frame comes",
    "stale_frames": "every frame was exposed before the motion ended",
    "short_frames": "a frame lacks its last row",
    "light_out": "the light is out",
    "uneven_light": "the light changes by .7 across the field",
    "mirror_camera": "the camera swaps left and right",
    "swap_camera": "the camera swaps x and y",
    "scale_camera": "the picture is 10 % too large",
    "reversed_axis": "x of the stage goes the other way and reads as told",
    "no_part": "the part is not there",
    "stick": "the released part follows a finger",
    "block": "the part comes to rest on its post",
}
# from the start on, or not at all
LASTING = ("no_part",)


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
                hint = meant(name, FAULTS)
                raise ValueError(f"no fault is called {name!r}{hint}; known: {known}")
            if step and name in LASTING:
                raise ValueError(f"{entry!r} names a step: {name} lasts the whole run")

    def enter(self, step: str) -> None:
        """Note which step runs now."""
        self._step = step

    def is_asked(self, name: str) -> bool:
        """Return whether a fault is at work in any step."""
        return any(entry.partition("@")[0] == name for entry in self.asked)

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
