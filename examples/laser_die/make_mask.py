"""Write the example's mask; run by hand: python make_mask.py [FOLDER].

GDSII by hand, so that the same script gives the same bytes: the dates that programs
write into every cell are zero here. One file holds the die, the submount and the
fingers, each a cell of its own; one database unit is 1 nm.
"""

from __future__ import annotations

import math
import struct
import sys
from pathlib import Path

from microplan.arrays import Point

CLADDING, VIA, TARGET, PLATE, MARK, LEFT, RIGHT = 1, 2, 3, 10, 11, 20, 21  # layers
# The die is drawn where it belongs on the submount, whose first mark is the origin.
DIE_AT_UM, DIE_UM = (0.0, 145.0), (250.0, 150.0)
VIA_UM, VIA_AT_UM = 10.0, 85.0  # radius; of the second from the first
PLATE_UM, PLATE_AT_UM = (900.0, 700.0), (0.0, 100.0)
MARK_UM, MARKS_UM = 15.0, 300.0  # radius; of the marks from each other
CORNERS = 128  # of a circle
FINGER_UM, LENGTH_UM, BEHIND_TIP_UM = 100.0, 20800.0, 200.0
TAPER_UM = 60.0  # the finger is this much wider at its root


def mask() -> bytes:
    """Return the whole file."""
    x, y = DIE_AT_UM
    circle = _structure("VIA", _boundary(VIA, _circle(VIA_UM)))
    mark = _structure("MARK", _boundary(MARK, _circle(MARK_UM)))
    second = _structure("TARGET", _boundary(TARGET, _circle(VIA_UM)))
    die = _structure(
        "DIE",
        _boundary(CLADDING, _box(DIE_AT_UM, DIE_UM)),
        _placed("VIA", (x, y)),
        _placed("TARGET", (x + VIA_AT_UM, y)),
        _text(CLADDING, (x, y - 40), "LASER 7"),
    )
    side = _structure("SIDE_MARK", _boundary(MARK + 1, _circle(MARK_UM)))
    submount = _structure(
        "SUBMOUNT",
        _boundary(PLATE, _box(PLATE_AT_UM, PLATE_UM)),
        _placed("MARK", (0.0, 0.0)),
        _placed("SIDE_MARK", (MARKS_UM, 0.0)),
    )
    fingers = _structure(
        "FINGERS", _boundary(LEFT, _finger(-1)), _boundary(RIGHT, _finger(1))
    )
    return (
        _record(0x00, 2, struct.pack(">h", 600))
        + _record(0x01, 2, bytes(24))
        + _record(0x02, 6, b"LASERDIE")
        + _record(0x03, 5, _real8(1e-3) + _real8(1e-9))  # in um, in m
        + b"".join((circle, second, mark, side, die, submount, fingers))
        + _record(0x04, 0, b"")
    )


def _finger(side: int) -> list[Point]:
    """Return one finger, jaws closed: its inner face at x = 0, the grip at 0."""
    tip, root = -BEHIND_TIP_UM, LENGTH_UM - BEHIND_TIP_UM
    return [
        (0.0, tip),
        (side * FINGER_UM, tip),
        (side * (FINGER_UM + TAPER_UM), root),
        (0.0, root),
    ]


def _box(middle: Point, size: Point) -> list[Point]:
    (x, y), (w, h) = middle, (size[0] / 2, size[1] / 2)
    return [(x - w, y - h), (x + w, y - h), (x + w, y + h), (x - w, y + h)]


def _circle(radius: float) -> list[Point]:
    """Return corners of a circle about 0, the way mask programs draw one."""
    angles = [math.tau * k / CORNERS for k in range(CORNERS)]
    return [(radius * math.cos(a), radius * math.sin(a)) for a in angles]


def _structure(name: str, *elements: bytes) -> bytes:
    begin = _record(0x05, 2, bytes(24)) + _record(0x06, 6, name.encode("ascii"))
    return begin + b"".join(elements) + _record(0x07, 0, b"")


def _boundary(layer: int, points: list[Point]) -> bytes:
    return _element(0x08, _layer(layer, 0x0E), _xy([*points, points[0]]))


def _placed(name: str, at: Point) -> bytes:
    return _element(0x0A, _record(0x12, 6, name.encode("ascii")), _xy([at]))


def _text(layer: int, at: Point, text: str) -> bytes:
    string = _record(0x19, 6, text.encode("ascii"))
    return _element(0x0C, _layer(layer, 0x16), _xy([at]), string)


def _element(kind: int, *records: bytes) -> bytes:
    return _record(kind, 0, b"") + b"".join(records) + _record(0x11, 0, b"")


def _layer(layer: int, type_kind: int) -> bytes:
    number = struct.pack(">h", layer)
    return _record(0x0D, 2, number) + _record(type_kind, 2, bytes(2))


def _xy(points: list[Point]) -> bytes:
    """Return points, um, as whole nm."""
    numbers = [round(1000 * c) for point in points for c in point]
    return _record(0x10, 3, struct.pack(f">{len(numbers)}i", *numbers))


def _record(kind: int, data_type: int, body: bytes) -> bytes:
    body += bytes(len(body) % 2)
    return struct.pack(">HBB", len(body) + 4, kind, data_type) + body


def _real8(value: float) -> bytes:
    """Return a positive number as sign, exponent to base 16 from 64, mantissa."""
    mantissa, exponent = math.frexp(value)
    sixteens = math.ceil(exponent / 4)
    word = round(math.ldexp(mantissa, 56 + exponent - 4 * sixteens))
    return struct.pack(">Q", (sixteens + 64) << 56 | word)


def write(folder: Path) -> None:
    """Write the mask into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "laser_die.gds").write_bytes(mask())


if __name__ == "__main__":
    write(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent / "parts")
