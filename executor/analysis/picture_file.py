"""A user's picture: PNG or TIFF, its size read before its pixels."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.errors import ExecutorError, why
from microplan.schemas.plan import Region, Requirements

SUFFIXES = (".png", ".tif", ".tiff")
SHALLOW = (10, 12, 14)  # bits that cameras have and programs keep in files of 16
LUMA = (0.299, 0.587, 0.114)  # red, green, blue: ITU-R BT.601, luma of a colour camera
_PNG = b"\x89PNG\r\n\x1a\n"
# uncompressed colour of 16 bits with alpha has 8 bytes per pixel; the rest is for
# thumbnails and notes that programs add
_BYTES_PER_PX, _MORE_BYTES = 16, 1 << 22


@dataclass(frozen=True, slots=True, kw_only=True)
class UserPicture:
    """A picture as 0..1 of full scale; `hint` is what its full scale may be instead."""

    image: FloatArray
    hint: str


def read_picture(
    path: Path, need: Requirements, region: Region, bits: int | None = None
) -> UserPicture:
    """Return a picture as 0..1 of full scale: the whole frame, or the region alone.

    Colour becomes grey by `LUMA`; alpha is left out. Full scale is 2**bits - 1; without
    `bits` it is that of the file for 8 bits, and for 16 bits that of the camera if it
    has more than 8, else of the file.

    Parameters
    ----------
    path : Path
        The file.
    need : Requirements
        The camera's size and bits.
    region : Region
        The look's; the only other size that is taken.
    bits : int, optional
        Of the picture's full scale.

    Returns
    -------
    UserPicture
        Of the whole frame's size or the region's; with a hint where a file of 16 bits
        that are taken as its full scale uses fewer.

    Raises
    ------
    ExecutorError
        MP878 with what is wrong.
    """
    if path.suffix.lower() not in SUFFIXES:
        _refuse(path, "it is no PNG or TIFF file")
    sizes = ((need.height_px, need.width_px), (region.rows, region.columns))
    most = _BYTES_PER_PX * max(h * w for h, w in sizes) + _MORE_BYTES
    try:
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except OSError as error:
        _refuse(path, why(error))
    size = size_of(data)
    if size is None:
        _refuse(path, "it is no PNG or TIFF file")
    if size not in sizes:
        wanted = " or ".join(f"{w} x {h}" for h, w in sizes)
        _refuse(path, f"it is {size[1]} x {size[0]} px, needed is {wanted}")
    if len(data) > most:
        _refuse(path, f"it is larger than {most} bytes")
    return _unit(path, _decoded(path, data, size), need.bits, bits)


def size_of(data: bytes) -> tuple[int, int] | None:
    """Return (rows, columns) of a PNG or TIFF file by its head, None if it is none."""
    try:
        if data.startswith(_PNG) and data[12:16] == b"IHDR":
            columns, rows = struct.unpack(">II", data[16:24])
            return (rows, columns)
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _tiff_size(data, "<" if data[:1] == b"I" else ">")
    except struct.error:
        return None
    return None


def _tiff_size(data: bytes, order: str) -> tuple[int, int] | None:
    """Return (rows, columns) of a TIFF file's first page."""
    (start,) = struct.unpack(order + "I", data[4:8])
    (count,) = struct.unpack_from(order + "H", data, start)
    found: dict[int, int] = {}
    for k in range(count):
        tag, kind = struct.unpack_from(order + "HH", data, start + 2 + 12 * k)
        if tag in (256, 257) and kind in (3, 4):  # width, height; 2 or 4 bytes
            form = order + ("H" if kind == 3 else "I")
            (found[tag],) = struct.unpack_from(form, data, start + 10 + 12 * k)
    if len(found) < 2:
        return None
    return (found[257], found[256])


def _decoded(path: Path, data: bytes, size: tuple[int, int]) -> Any:
    """Return the pixels as they are in the file, uint8 or uint16."""
    import cv2  # heavy, and only this mode reads pictures

    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        found: Any = cv2.imdecode(
            np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED
        )
    except cv2.error as error:
        _refuse(path, f"it cannot be read: {error.err}")
    finally:
        cv2.utils.logging.setLogLevel(level)
    if found is None or found.shape[:2] != size:
        _refuse(path, "it is damaged")
    if found.dtype not in (np.uint8, np.uint16):
        _refuse(path, f"its pixels are {found.dtype}, needed are 8 or 16 bits")
    return found


def _unit(path: Path, counts: Any, camera_bits: int, asked: int | None) -> UserPicture:
    """Return grey counts as 0..1 of full scale."""
    own = 8 if counts.dtype == np.uint8 else 16
    deep = own == 16 and camera_bits > 8
    bits = asked or (camera_bits if deep else own)
    most = int(counts[..., :3].max() if counts.ndim == 3 else counts.max())
    if most > 2**bits - 1:
        _refuse(
            path, f"it holds {most}, full scale of {bits} bits is {2**bits - 1}: --bits"
        )
    hint = "" if asked or bits != own or own == 8 else _shallower(most)
    return UserPicture(image=_grey(counts) / float(2**bits - 1), hint=hint)


def _shallower(most: int) -> str:
    """Return which camera's bits a file of 16 may hold, "" for all of them."""
    bits = next((b for b in SHALLOW if most < 2**b), None)
    if bits is None:
        return ""
    return (
        f"it holds at most {most} of 65535: if its full scale is {bits} bits, say "
        f"--bits {bits}"
    )


def _grey(counts: Any) -> FloatArray:
    """Return one value per pixel; OpenCV has colours as blue, green, red."""
    grey: FloatArray
    if counts.ndim == 3 and counts.shape[2] >= 3:
        red, green, blue = LUMA
        grey = counts[..., :3].astype(np.float64) @ np.array([blue, green, red])
    else:  # grey, perhaps with alpha
        grey = (counts if counts.ndim == 2 else counts[..., 0]).astype(np.float64)
    return grey


def _refuse(path: Path, what: str) -> NoReturn:
    """Raise MP878 about a file."""
    raise ExecutorError("MP878", f"{path.name}: {what}", place=path)
