"""Versions of file formats, "major.minor", that a reader takes.

A newer minor adds keys that an older reader may pass over; a newer major changes what
is there. `docs/formats.md` has the rules.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

_FORM = re.compile(r"(0|[1-9][0-9]{0,5})\.(0|[1-9][0-9]{0,5})", re.ASCII)


class VersionError(ValueError):
    """A version that is none, or that this reader does not take; says what to do."""


@dataclass(frozen=True, slots=True, order=True)
class Version:
    """The version of a format."""

    major: int
    minor: int

    @classmethod
    def of(cls, text: Any) -> Version:
        """Return the version that a file states; VersionError if it states none."""
        found = _FORM.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            said = "nothing" if text is None else f"{text!r:.40}"
            raise VersionError(
                f'must be text "major.minor" as in "2.3", got {said}: this is no file '
                "of microplan, or it was changed"
            )
        return cls(int(found[1]), int(found[2]))

    def __str__(self) -> str:
        """Return it as files state it."""
        return f"{self.major}.{self.minor}"


def check(text: Any, ours: str) -> None:
    """Raise VersionError unless a reader of version `ours` takes the one stated.

    It takes every minor version of its own major: what an older one lacks has defaults,
    and what a newer one adds is passed over.
    """
    found, known = Version.of(text), Version.of(ours)
    if found.major > known.major:
        raise VersionError(
            f"{found} is newer than this microplan, which reads {known.major}.x: "
            "update microplan, or compile the task again with this one"
        )
    if found.major < known.major:
        raise VersionError(
            f"{found} is older than this microplan, which reads {known.major}.x: "
            "compile the task again"
        )


def is_newer(text: str, ours: str) -> bool:
    """Return whether a version that can be read may hold keys that are passed over."""
    return Version.of(text) > Version.of(ours)
