"""Write the example's drawings; run by hand: python make_parts.py [FOLDER].

Plain DXF R12 by hand, so that the same script gives the same bytes: programs that write
DXF put clocks and random identifiers into the header.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from microplan.arrays import Point

TEETH = 18
OUTER_UM, ROOT_UM, BORE_UM = 50.0, 45.0, 25.0
TIP_DEG, GAP_DEG = 8.0, 8.0  # angles of a tooth's tip and of the gap at its root
NOTCH_WIDTH_UM, NOTCH_DEPTH_UM = 6.0, 5.0
PLATE_UM, CHAMFER_UM, HOLE_UM, HOLE_AT_UM = 700.0, 60.0, 40.0, 270.0
POST_UM = 22.0
FINGER_UM, LENGTH_UM, BEHIND_TIP_UM = 100.0, 20800.0, 60.0
TAPER_UM, TIP_RADIUS_UM = 60.0, 10.0  # the finger is this much wider at its root


def gear() -> str:
    """Return the gear: a tooth's middle at 0 degrees, the notch at 90, in a gap."""
    pitch = 360 / TEETH
    out = []
    for k in range(TEETH):
        tip = (pitch * k - TIP_DEG / 2, pitch * k + TIP_DEG / 2)
        middle = pitch * k + pitch / 2
        root = (middle - GAP_DEG / 2, middle + GAP_DEG / 2)
        out += [
            _arc("OUTLINE", (0, 0), OUTER_UM, *tip),
            _line("OUTLINE", _polar(OUTER_UM, tip[1]), _polar(ROOT_UM, root[0])),
            _arc("OUTLINE", (0, 0), ROOT_UM, *root),
            _line(
                "OUTLINE", _polar(ROOT_UM, root[1]), _polar(OUTER_UM, tip[0] + pitch)
            ),
        ]
    return _file(out + _bore())


def _bore() -> list[str]:
    """Return the bore, with a notch cut outward at 90 degrees."""
    half = NOTCH_WIDTH_UM / 2
    leave = math.degrees(math.asin(half / BORE_UM))
    edge = BORE_UM * math.cos(math.radians(leave))
    top = BORE_UM + NOTCH_DEPTH_UM
    return [
        _arc("BORE", (0, 0), BORE_UM, 90 + leave, 450 - leave),
        _line("BORE", (half, edge), (half, top)),
        _line("BORE", (half, top), (-half, top)),
        _line("BORE", (-half, top), (-half, edge)),
    ]


def shaft_plate() -> str:
    """Return the plate with chamfered corners and four holes, and the post."""
    h, c = PLATE_UM / 2, PLATE_UM / 2 - CHAMFER_UM
    corners = [(c, -h), (h, -c), (h, c), (c, h), (-c, h), (-h, c), (-h, -c), (-c, -h)]
    ends = corners[1:] + corners[:1]
    out = [_line("PLATE", a, b) for a, b in zip(corners, ends, strict=True)]
    for x in (-HOLE_AT_UM, HOLE_AT_UM):
        out += [_circle("PLATE", (x, y), HOLE_UM) for y in (-HOLE_AT_UM, HOLE_AT_UM)]
    return _file([*out, _circle("POST", (0, 0), POST_UM)])


def tweezer_fingers() -> str:
    """Return both fingers with the jaws closed: inner faces at x = 0, the grip at 0."""
    return _file(_finger("FINGER_L", -1) + _finger("FINGER_R", 1))


def _finger(layer: str, side: int) -> list[str]:
    """Return one finger: a straight inner face, a round outer tip, a tapered back."""
    tip, root = -BEHIND_TIP_UM, LENGTH_UM - BEHIND_TIP_UM
    r, wide = TIP_RADIUS_UM, FINGER_UM
    inner, outer = (0.0, tip), (side * (wide - r), tip)
    side_low, side_high = (side * wide, tip + r), (side * (wide + TAPER_UM), root)
    angles = (-90.0, 0.0) if side > 0 else (180.0, 270.0)
    return [
        _line(layer, inner, outer),
        _arc(layer, (side * (wide - r), tip + r), r, *angles),
        _line(layer, side_low, side_high),
        _line(layer, side_high, (0.0, root)),
        _line(layer, (0.0, root), inner),
    ]


def _polar(radius: float, angle_deg: float) -> Point:
    angle = math.radians(angle_deg)
    return (radius * math.cos(angle), radius * math.sin(angle))


def _line(layer: str, start: Point, end: Point) -> str:
    return _tags(("0", "LINE"), ("8", layer), *_at(start, 0), *_at(end, 1))


def _arc(layer: str, center: Point, radius: float, start: float, end: float) -> str:
    return _tags(
        ("0", "ARC"), ("8", layer), *_at(center, 0), ("40", _number(radius)),
        ("50", _number(start % 360)), ("51", _number(end % 360)),
    )  # fmt: skip


def _circle(layer: str, center: Point, radius: float) -> str:
    return _tags(
        ("0", "CIRCLE"), ("8", layer), *_at(center, 0), ("40", _number(radius))
    )


def _at(point: Point, index: int) -> list[tuple[str, str]]:
    """Return the tags of a point; x, y, z are 10, 20, 30, then 11, 21, 31."""
    x, y = point
    values = (_number(x), _number(y), "0.0")
    return [(f"{k}{index}", value) for k, value in zip("123", values, strict=True)]


def _number(value: float) -> str:
    """Return 12 decimals, a millionth of an atom, the same on every machine."""
    text = f"{value:.12f}".rstrip("0")
    text += "0" * text.endswith(".")
    return "0.0" if text == "-0.0" else text


def _file(entities: list[str]) -> str:
    """Return a whole file; $INSUNITS 13 is um."""
    header = _tags(
        ("0", "SECTION"), ("2", "HEADER"), ("9", "$ACADVER"), ("1", "AC1009"),
        ("9", "$INSUNITS"), ("70", "13"), ("0", "ENDSEC"),
        ("0", "SECTION"), ("2", "ENTITIES"),
    )  # fmt: skip
    return header + "".join(entities) + _tags(("0", "ENDSEC"), ("0", "EOF"))


def _tags(*pairs: tuple[str, str]) -> str:
    return "".join(f"{code:>3}\n{value}\n" for code, value in pairs)


def write(folder: Path) -> None:
    """Write the three drawings into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (
        ("gear18", gear()),
        ("shaft_plate", shaft_plate()),
        ("tweezer_fingers", tweezer_fingers()),
    ):
        (folder / f"{name}.dxf").write_bytes(text.encode("ascii"))


if __name__ == "__main__":
    write(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent / "parts")
