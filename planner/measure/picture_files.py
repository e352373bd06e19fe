"""Pictures of PNG and TIFF files as grey counts, one in memory at a time."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.source.diagnostics import CallError

CODE = "MP901"
MOST_PX = 1 << 26  # more than cameras have; larger ones are not decoded
_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # the last two: BigTIFF
_TAKEN = "PNG and TIFF pictures of 8 to 16 bits are taken"
# what decoders raise at damaged files; SyntaxError and TypeError are Pillow's
_UNREADABLE = (
    OSError, ValueError, SyntaxError, TypeError, LookupError, EOFError, struct.error,
    zlib.error, NotImplementedError, RuntimeError, MemoryError,
)  # fmt: skip

# of (rows, columns) why a picture of that size is not taken and what is, None if it is
SizeCheck = Callable[[int, int], tuple[str, str] | None]


class PictureError(CallError):
    """MP901: why a picture cannot be used, and what to take instead."""

    def __init__(self, path: Path, message: str, hint: str) -> None:
        super().__init__(CODE, message, path, hint)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureCounts:
    """A picture as a file has it, in grey."""

    name: str  # the file's, of a page of several with its number from 0: "a.tif[3]"
    path: Path
    counts: FloatArray  # (rows, columns), as in the file
    file_bits: int  # 8 or 16, of the file's pixels
    is_colour: bool  # the counts are made of three colours that differ


def files_of(paths: Sequence[Path]) -> list[Path | PictureError]:
    """Return the files of a call, those of folders by name, or what they are instead.

    A file whose name begins with a dot is the file manager's. Only heads are read.
    """
    return [_known(file) for path in paths for file in _listed(path)]


def _listed(path: Path) -> Sequence[Path | PictureError]:
    """Return the files of a folder, or a file itself."""
    if not path.is_dir():
        return (path,)
    try:
        inside = sorted(file for file in path.iterdir() if file.is_file())
    except OSError as error:
        return (PictureError(path, _unread(path.name, error), _TAKEN),)
    shown = [file for file in inside if not file.name.startswith(".")]
    return shown or (PictureError(path, f"{path} holds no file", _TAKEN),)


def _known(file: Path | PictureError) -> Path | PictureError:
    """Return a file that begins as PNG and TIFF files do, or why it is none."""
    if isinstance(file, PictureError):
        return file
    try:
        with file.open("rb") as stream:
            head = stream.read(len(_PNG))
    except OSError as error:
        return PictureError(file, _unread(file.name, error), _TAKEN)
    if head == _PNG or head[:4] in _TIFF:
        return file
    return PictureError(file, f"{file.name} is no PNG or TIFF file", _TAKEN)


def pages_of(file: Path, check: SizeCheck) -> Iterator[PictureCounts | PictureError]:
    """Yield the pictures of a file that `files_of` returned, or why one cannot be used.

    Parameters
    ----------
    file : Path
        PNG has one picture, TIFF one a page.
    check : callable
        Gets rows and columns before pixels are decoded.
    """
    try:
        with file.open("rb") as stream:
            is_png = stream.read(len(_PNG)) == _PNG
        yield from (_png if is_png else _tiff)(file, check)
    except PictureError as error:
        yield error
    except _UNREADABLE as error:
        yield PictureError(file, _unread(file.name, error), _TAKEN)


def _png(file: Path, check: SizeCheck) -> Iterator[PictureCounts]:
    """Yield the picture of a PNG file."""
    from skimage.io import imread

    with file.open("rb") as stream:
        stream.seek(16)
        columns, rows = struct.unpack(">II", stream.read(8))
    _check_size(file, file.name, (rows, columns), check)
    yield _grey(file, file.name, imread(file))


def _tiff(file: Path, check: SizeCheck) -> Iterator[PictureCounts | PictureError]:
    """Yield the pages of a TIFF file; what is wrong with one says nothing of others."""
    import tifffile

    with tifffile.TiffFile(file) as tiff:
        every: list[Any] = list(tiff.pages)
        pages = [page for page in every if not page.is_reduced]  # no thumbnails
        if not pages:
            raise PictureError(file, _unread(file.name, ValueError("no page")), _TAKEN)
        for number, page in enumerate(pages):
            name = f"{file.name}[{number}]" if len(pages) > 1 else file.name
            try:
                yield _page(file, name, page, check)
            except PictureError as error:
                yield error
            except _UNREADABLE as error:
                hint = f"save it without compression; {_TAKEN}"
                yield PictureError(file, _unread(name, error), hint)


def ome_text(file: Path) -> tuple[str, int] | None:
    """Return the OME-XML of a TIFF file and its number of pages, None without one."""
    import tifffile

    try:
        with tifffile.TiffFile(file) as tiff:
            text = tiff.ome_metadata if tiff.is_ome else None
            return None if text is None else (str(text), len(tiff.pages))
    except _UNREADABLE:
        return None  # what is wrong with it is said when its pictures are read


def _page(file: Path, name: str, page: Any, check: SizeCheck) -> PictureCounts:
    """Return one page of a TIFF file."""
    _check_size(file, name, (page.imagelength, page.imagewidth), check)
    kind = page.photometric.name
    if kind not in ("MINISBLACK", "RGB"):
        hint = "save it as grey, black as 0, or as red, green and blue"
        raise PictureError(file, f"{name} has its brightness as {kind}", hint)
    if page.compression.name == "LZW":  # which tifffile alone does not decode
        return _grey(file, name, _by_pillow(file, page.index))
    pixels = page.asarray()
    if pixels.ndim == 3 and page.planarconfig.name == "SEPARATE":
        pixels = np.moveaxis(pixels, 0, -1)
    return _grey(file, name, pixels)


def _by_pillow(file: Path, number: int) -> Any:
    """Return a page's pixels, (rows, columns) or (rows, columns, colours)."""
    from PIL import Image

    with Image.open(file) as pages:
        pages.seek(number)
        return np.asarray(pages)


def _check_size(file: Path, name: str, size: tuple[int, int], check: SizeCheck) -> None:
    """Raise if a picture of (rows, columns) is not taken."""
    rows, columns = size
    if rows * columns > MOST_PX:
        message = f"{name} has {rows * columns} px, at most {MOST_PX} are read"
        raise PictureError(file, message, "cut out the part about the target")
    if (refused := check(rows, columns)) is not None:
        raise PictureError(file, f"{name}: {refused[0]}", refused[1])


def _grey(file: Path, name: str, pixels: Any) -> PictureCounts:
    """Return pixels (rows, columns) or (rows, columns, colours) as grey counts."""
    if pixels.dtype not in (np.uint8, np.uint16):
        message = f"{name} has pixels of type {pixels.dtype}"
        raise PictureError(file, message, _TAKEN)
    if pixels.ndim not in (2, 3):
        message = f"{name} has {pixels.ndim} dimensions"
        raise PictureError(file, message, "save each plane as a page")
    is_colour = False
    if pixels.ndim == 3:
        colours = pixels[..., :3] if pixels.shape[2] > 2 else pixels[..., :1]
        is_colour = bool((colours != colours[..., :1]).any())
        pixels = _luminance(colours) if is_colour else colours[..., 0]
    return PictureCounts(
        name=name,
        path=file,
        counts=np.asarray(pixels, dtype=np.float64),
        file_bits=8 if pixels.dtype == np.uint8 else 16,
        is_colour=is_colour,
    )


def _luminance(colours: Any) -> Any:
    """Return colours (rows, columns, 3) as grey of the same type."""
    from skimage.color import rgb2gray

    most = np.iinfo(colours.dtype).max
    return np.rint(rgb2gray(colours) * most).astype(colours.dtype)


def _unread(name: str, error: BaseException) -> str:
    """Return that a file cannot be read, and why."""
    why = error.strerror if isinstance(error, OSError) else ""
    return f"{name} cannot be read: {why or error or type(error).__name__}"
