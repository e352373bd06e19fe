"""The tags of a DXF file: group codes with their values, from text or binary.

Text files give every value as text, binary files numbers as numbers. Layout of both
kinds: Autodesk, DXF Reference, "ASCII DXF Files" and "Binary DXF Files".
"""

from __future__ import annotations

import codecs
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

Value = str | float

_SENTINEL = b"AutoCAD Binary DXF\r\n\x1a\x00"
_ESCAPED = re.compile(r"\\U\+([0-9A-Fa-f]{4})")
_PAGE = re.compile(rb"\$DWGCODEPAGE[\s\x00]+3?[\s\x00]+(?:ansi_|dos)(\d{3,4})", re.I)

# group codes and how a binary file stores their values; the others are text
_BINARY = (
    (10, 59, "<d"), (60, 79, "<h"), (90, 99, "<i"), (110, 149, "<d"),
    (160, 169, "<q"), (170, 179, "<h"), (210, 239, "<d"), (270, 289, "<h"),
    (290, 299, "<b"), (370, 389, "<h"), (400, 409, "<h"), (420, 429, "<i"),
    (440, 459, "<i"), (460, 469, "<d"), (1010, 1059, "<d"), (1060, 1070, "<h"),
    (1071, 1071, "<i"),
)  # fmt: skip
_FORMATS = {
    code: struct.Struct(form)
    for low, high, form in _BINARY
    for code in range(low, high + 1)
}
_CHUNKS = frozenset((*range(310, 320), 1004))  # a length byte, then that many bytes


class DxfError(ValueError):
    """The bytes are no DXF file, or not a whole one; the message says where."""


@dataclass(frozen=True, slots=True)
class Tags:
    """Group codes and values of a file, in order, up to its end mark."""

    codes: list[int]
    values: list[Value]
    offsets: list[int] | None  # of the values in a binary file, bytes

    def where(
        self, code: int, first: int = 0, last: int | None = None
    ) -> Iterator[int]:
        """Yield the indices of a group code, of those from `first` to before `last`."""
        at, end = first - 1, len(self.codes) if last is None else last
        try:
            while True:
                at = self.codes.index(code, at + 1, end)
                yield at
        except ValueError:
            return

    def place(self, index: int) -> str:
        """Return the line or byte of a value in the file."""
        if self.offsets is None:
            return f"line {2 * index + 2}"
        return f"byte {self.offsets[index]}"


def read_tags(data: bytes) -> Tags:
    """Return the tags of a DXF file up to its end mark.

    Parameters
    ----------
    data : bytes
        The whole file, R12 to R2018, text or binary.

    Raises
    ------
    DxfError
        If the file ends without its end mark or a tag is malformed.
    """
    if is_binary(data):
        tags = _binary(data)
    elif b"\x00" in data[:4096]:
        raise DxfError("it holds bytes that no text has; DWG must be saved as DXF")
    else:
        tags = _text(data)
    for at in tags.where(0):
        if str(tags.values[at]).strip() == "EOF":
            return Tags(tags.codes[:at], tags.values[:at], tags.offsets)
    raise DxfError("it ends without its end mark EOF, as if cut short")


def is_binary(data: bytes) -> bool:
    """Return whether a file is a binary DXF file."""
    return data.startswith(_SENTINEL)


def text_of(data: bytes) -> str:
    """Return the text of a text file, in the code page that it names if not UTF-8."""
    return _decoded(data.removeprefix(codecs.BOM_UTF8), _code_page(data))


def unescaped(name: str) -> str:
    r"""Return `name` with \U+XXXX replaced by the character it encodes."""
    return _ESCAPED.sub(lambda match: chr(int(match[1], 16)), name)


class _Codes(dict[str, int]):
    """Group codes by the lines that hold them; files repeat a few dozen lines."""

    def __missing__(self, line: str) -> int:
        code = self[line] = int(line)
        return code


def _text(data: bytes) -> Tags:
    """Return the tags of a text file; one line holds the code, the next the value."""
    text = text_of(data)
    lines = text.split("\n" if "\n" in text else "\r")
    values: list[Value] = list(lines[1::2])
    wanted = lines[: 2 * len(values) : 2]
    codes: list[int] = []
    try:
        codes.extend(map(_Codes().__getitem__, wanted))
    except ValueError:
        if any(line.strip() == "EOF" for line in lines[1 : 2 * len(codes) : 2]):
            return Tags(codes, values, None)  # what follows the end is no matter
        number = 2 * len(codes)
        said = lines[number][:20].strip()
        message = f"line {number + 1} should be a group code, it is {said!r}"
        raise DxfError(message) from None
    return Tags(codes, values, None)


def _binary(data: bytes) -> Tags:
    """Return the tags of a binary file."""
    page = _code_page(data)
    at = len(_SENTINEL)
    short = data[at + 1 : at + 2] != b"\x00"  # R12 writes group codes in one byte
    codes: list[int] = []
    values: list[Value] = []
    offsets: list[int] = []
    try:
        while at < len(data):
            code = data[at] if short else struct.unpack_from("<H", data, at)[0]
            at += 1 if short else 2
            if short and code == 255:
                code, at = struct.unpack_from("<H", data, at)[0], at + 2
            offsets.append(at)
            value, at = _value(data, at, code, page)
            codes.append(code)
            values.append(value)
            if code == 0 and value == "EOF":
                break
    except (struct.error, IndexError, ValueError) as error:
        raise DxfError(f"it is cut short at byte {at}: {error}") from None
    return Tags(codes, values, offsets)


def _value(data: bytes, at: int, code: int, page: str) -> tuple[Value, int]:
    """Return the value of a binary tag and where the next tag begins."""
    if form := _FORMATS.get(code):
        return form.unpack_from(data, at)[0], at + form.size
    if code in _CHUNKS:
        return "", at + 1 + data[at]
    end = data.index(b"\x00", at)
    return _decoded(data[at:end], page), end + 1


def _decoded(raw: bytes, page: str) -> str:
    """Return text; R2007 and later write UTF-8, others the page they name."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode(page, errors="replace")  # of use to names alone


def _code_page(data: bytes) -> str:
    """Return the codec of the code page that the header names."""
    found = _PAGE.search(data, 0, 1 << 16)
    name = f"cp{found[1].decode()}" if found else "cp1252"
    try:
        return codecs.lookup(name).name
    except LookupError:
        return "cp1252"
