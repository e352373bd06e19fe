"""How a run with each fault of the simulated cell must end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# what a look at something wrong may end in; `verify` calls what it does not see MP850
_LOOK = ("MP820", "MP821", "MP822", "MP823", "MP825", "MP826", "MP850")
_SERVO = ("MP830", "MP831", "MP832")
# the probe; a first look may not know what it sees in a mirror
_TWISTED = ("MP833", "MP835", "MP820", "MP821")


@dataclass(frozen=True, slots=True)
class FaultEnd:
    """The codes one of which a run with a fault must end in.

    `codes` are for a fault that begins in some step, `from_start` for one that is there
    before the first motion by camera; () if that makes no difference. A run that
    `may_stand` it may also end well: then the part is truly seated.
    """

    codes: tuple[str, ...]
    may_stand: bool = False
    from_start: tuple[str, ...] = ()


_AXIS = {
    "axis_raises": FaultEnd(("MP841",)),
    "axis_hangs": FaultEnd(("MP844",)),
    "axis_never_ready": FaultEnd(("MP845",)),
    "axis_short": FaultEnd(("MP845",)),
    # a motion shorter than the window that stalls is one that never ends
    "axis_stalls": FaultEnd(("MP846", "MP845")),
    # it may leave the limits before it is seen to go the wrong way
    "axis_wrong_way": FaultEnd(("MP846", "MP840")),
    "axis_slips": FaultEnd(("MP846",)),
    "axis_nan": FaultEnd(("MP847",)),
}
_JAWS = {
    "jaws_raise": FaultEnd(("MP841",)),
    "jaws_hang": FaultEnd(("MP844",)),
    "jaws_stuck": FaultEnd(("MP849",)),
    "jaws_nan": FaultEnd(("MP847",)),
}
_OPTICS = {
    "lens_raises": FaultEnd(("MP841",)),
    "lens_hangs": FaultEnd(("MP844",)),
    "lens_stuck": FaultEnd(("MP845",)),
    "lens_nan": FaultEnd(("MP847",)),
    "camera_raises": FaultEnd(("MP841",)),
    "camera_hangs": FaultEnd(("MP844",)),
    "dropped_frames": FaultEnd(("MP848",)),
    "stale_frames": FaultEnd(("MP848",)),
    "short_frames": FaultEnd(("MP841",)),
    "light_out": FaultEnd(_LOOK),
    "uneven_light": FaultEnd(
        (*_LOOK, "MP851", "MP853"),
        may_stand=True,
    ),
}
# Only a picture tells these: the probe; else a look's gates, or an alignment that does
# not end, or leads where something stands.
_LATER = (*_LOOK, *_SERVO, "MP836")
_GEOMETRY = {
    "mirror_camera": FaultEnd(_LATER, from_start=_TWISTED),
    "swap_camera": FaultEnd(_LATER, from_start=_TWISTED),
    "scale_camera": FaultEnd(
        (*_LATER, "MP851"),
        from_start=("MP834", "MP835", "MP820", "MP821", "MP825"),
    ),
    "reversed_axis": FaultEnd(
        _LATER,
        from_start=_TWISTED,
    ),
    "no_part": FaultEnd(_LOOK),
}
_CONTACT = {
    "stick": FaultEnd(("MP850", "MP854")),
    "block": FaultEnd(("MP850", "MP851", "MP852", "MP853")),
}

ENDS: Mapping[str, FaultEnd] = {**_AXIS, **_JAWS, **_OPTICS, **_GEOMETRY, **_CONTACT}
