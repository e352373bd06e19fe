"""Records of a GDSII stream file: bytes in, checked records out.

A record is a two-byte length, a kind, a data type and its data, big-endian throughout.
Format: Calma, GDSII Stream Format Manual, release 6.0 (1987).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

MAX_RECORDS = 500_000  # a mask of 100 000 shapes

# kind -> name, data type, bytes of its data: n exactly, -n a multiple of n, 0 none
_KINDS = {
    0x00: ("HEADER", 2, 2), 0x01: ("BGNLIB", 2, 24), 0x02: ("LIBNAME", 6, -1),
    0x03: ("UNITS", 5, 16), 0x04: ("ENDLIB", 0, 0), 0x05: ("BGNSTR", 2, 24),
    0x06: ("STRNAME", 6, -1), 0x07: ("ENDSTR", 0, 0), 0x08: ("BOUNDARY", 0, 0),
    0x09: ("PATH", 0, 0), 0x0A: ("SREF", 0, 0), 0x0B: ("AREF", 0, 0),
    0x0C: ("TEXT", 0, 0), 0x0D: ("LAYER", 2, 2), 0x0E: ("DATATYPE", 2, 2),
    0x0F: ("WIDTH", 3, 4), 0x10: ("XY", 3, -8), 0x11: ("ENDEL", 0, 0),
    0x12: ("SNAME", 6, -1), 0x13: ("COLROW", 2, 4), 0x15: ("NODE", 0, 0),
    0x16: ("TEXTTYPE", 2, 2), 0x17: ("PRESENTATION", 1, 2), 0x19: ("STRING", 6, -1),
    0x1A: ("STRANS", 1, 2), 0x1B: ("MAG", 5, 8), 0x1C: ("ANGLE", 5, 8),
    0x1F: ("REFLIBS", 6, -1), 0x20: ("FONTS", 6, -1), 0x21: ("PATHTYPE", 2, 2),
    0x22: ("GENERATIONS", 2, 2), 0x23: ("ATTRTABLE", 6, -1), 0x26: ("ELFLAGS", 1, 2),
    0x2A: ("NODETYPE", 2, 2), 0x2B: ("PROPATTR", 2, 2), 0x2C: ("PROPVALUE", 6, -1),
    0x2D: ("BOX", 0, 0), 0x2E: ("BOXTYPE", 2, 2), 0x2F: ("PLEX", 3, 4),
    0x30: ("BGNEXTN", 3, 4), 0x31: ("ENDEXTN", 3, 4), 0x34: ("STRCLASS", 1, 2),
    0x36: ("FORMAT", 2, 2), 0x37: ("MASK", 6, -1), 0x38: ("ENDMASKS", 0, 0),
    0x39: ("LIBDIRSIZE", 2, 2), 0x3A: ("SRFNAME", 6, -1), 0x3B: ("LIBSECUR", 2, -2),
}  # fmt: skip


class GdsError(ValueError):
    """What cannot be read, and at which byte of the file (-1: of no single byte)."""

    def __init__(self, code: str, offset: int, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.code, self.offset, self.message, self.hint = code, offset, message, hint


class GdsRecord(NamedTuple):
    """One record; `offset` is that of its first byte in the file."""

    offset: int
    name: str
    body: bytes


def records(data: bytes) -> Iterator[GdsRecord]:
    """Yield the records of a whole stream file up to and with ENDLIB.

    Raises
    ------
    GdsError
        MP230 where a record breaks the format, the file ends early, or something but
        zeros (the padding of a tape's last block) follows ENDLIB; MP215 if there are
        more than MAX_RECORDS.
    """
    offset, count = 0, 0
    while True:
        record, after = _record(data, offset)
        count += 1
        if count > MAX_RECORDS:
            message = f"more than {MAX_RECORDS} records"
            raise GdsError("MP215", offset, message, "keep only the cells needed")
        yield record
        offset = after
        if record.name == "ENDLIB":
            break
    rest = data[offset:].lstrip(b"\0")
    if rest:
        message = f"{len(rest)} bytes follow ENDLIB"
        raise GdsError("MP230", len(data) - len(rest), message)


def _record(data: bytes, offset: int) -> tuple[GdsRecord, int]:
    """Return the record at `offset`, and where the next one begins."""
    if offset + 4 > len(data):
        raise GdsError("MP230", offset, "the file ends before ENDLIB")
    length, kind, data_type = struct.unpack_from(">HBB", data, offset)
    if length < 4 or length % 2:
        message = f"a record's length is {length}, even and at least 4 are allowed"
        raise GdsError("MP230", offset, message)
    if kind not in _KINDS:
        raise GdsError("MP230", offset, f"record kind 0x{kind:02x} is unknown")
    name, wanted, size = _KINDS[kind]
    if data_type != wanted:
        message = f"{name} has data type {data_type}, {wanted} is right"
        raise GdsError("MP230", offset, message)
    if (length - 4) % -size if size < 0 else length - 4 != size:
        message = f"{name} holds {length - 4} bytes, {_sizes(size)} allowed"
        raise GdsError("MP230", offset, message)
    if offset + length > len(data):
        message = f"{name} of {length} bytes runs past the end of the file"
        raise GdsError("MP230", offset, message)
    return GdsRecord(offset, name, data[offset + 4 : offset + length]), offset + length


def _sizes(size: int) -> str:
    return f"multiples of {-size}" if size < 0 else str(size)


def text(record: GdsRecord) -> str:
    """Return the text of a record, without the zero that makes its length even."""
    body = record.body[:-1] if record.body.endswith(b"\0") else record.body
    if not body or not all(32 <= byte < 127 for byte in body):
        message = f"{record.name} must hold printable characters, got {body[:32]!r}"
        raise GdsError("MP230", record.offset, message)
    return body.decode("ascii")


def integers(record: GdsRecord) -> tuple[int, ...]:
    """Return the signed integers of a record whose data are two or four bytes each."""
    size, letter = (4, "i") if record.name in _LONG else (2, "h")
    return struct.unpack(f">{len(record.body) // size}{letter}", record.body)


_LONG = frozenset(name for name, data_type, _ in _KINDS.values() if data_type == 3)


def bits(record: GdsRecord) -> int:
    """Return the sixteen bits of a record, or its two bytes without a sign."""
    (value,) = struct.unpack(">H", record.body)
    return int(value)


def reals(record: GdsRecord) -> tuple[float, ...]:
    """Return the eight-byte reals of a record."""
    body = record.body
    return tuple(real8(body[k : k + 8]) for k in range(0, len(body), 8))


def real8(body: bytes) -> float:
    """Return an eight-byte real as a float.

    One bit of sign, seven of an exponent to base 16 from 64, 56 of a mantissa below 1,
    which is rounded to the 53 of a float. Every pattern is a finite number, 7.2e75 at
    most.
    """
    (word,) = struct.unpack(">Q", body)
    sign = -1.0 if word >> 63 else 1.0
    exponent = (word >> 56 & 0x7F) - 64
    return sign * math.ldexp(float(word & (1 << 56) - 1), 4 * exponent - 56)
