"""Reference images as OME-TIFF: grey pixels, described in OME-XML."""

from __future__ import annotations

import io
import re
from xml.etree import ElementTree as ET

import tifffile

from microplan.planner.export.folder import ExportedPlan, Viewed
from microplan.planner.export.sight import microscope
from microplan.planner.store.pictures import Picture

NAMESPACE = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
_LOCATION = f"{NAMESPACE} {NAMESPACE}/ome.xsd"
_NOTES = "microplan.look"  # what kind of notes the map of names and values holds
NM_PER_UM = 1000.0
# the media that OME-XML knows by name, by index, and how near one must be
_MEDIA = ((1.0, "Air"), (1.333, "Water"), (1.47, "Glycerol"), (1.515, "Oil"))
_NEAR = 0.01
_ILLEGAL = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def ome_tiff(folder: ExportedPlan, viewed: Viewed) -> bytes:
    """Return a look's reference image as an OME-TIFF file.

    One plane of 8 bit, uncompressed, little-endian. The same plan gives the same
    bytes: neither time nor machine is noted.

    Raises
    ------
    ExportError
        MP721 if the plan folder does not hold the image.
    """
    image = folder.picture(viewed.look)
    text = ome_xml(folder, viewed)
    return tiff(image, text, viewed.look.view.um_per_px)


def ome_xml(folder: ExportedPlan, viewed: Viewed) -> str:
    """Return the description of a look's image in ASCII."""
    root = ET.Element(
        "OME",
        {
            "xmlns": NAMESPACE,
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:schemaLocation": _LOCATION,
            "Creator": "microplan",
        },
    )
    _instrument(root, folder, viewed)
    _image(root, folder, viewed)
    _notes(root, folder, viewed)
    for element in root.iter():  # names in files may hold what XML has no place for
        element.text = _legal(element.text)
        for name, value in element.items():
            element.set(name, _legal(value) or "")
    data: bytes = ET.tostring(root, encoding="us-ascii", xml_declaration=True)
    return data.decode("ascii")


def tiff(image: Picture, description: str, um_per_px: float) -> bytes:
    """Return a baseline TIFF file of one grey page, its pixels in one strip.

    Parameters
    ----------
    image : (rows, columns) uint8 array
        The pixels.
    description : str
        ASCII text of the page.
    um_per_px : float
        Distance of pixel centres, um; the file has its inverse per cm.
    """
    stream = io.BytesIO()
    tifffile.imwrite(
        stream,
        image,
        photometric="minisblack",
        description=description,
        metadata=None,
        resolution=2 * (1e4 / um_per_px,),
        resolutionunit="CENTIMETER",
        software=False,
    )
    return stream.getvalue()


def _instrument(root: ET.Element, folder: ExportedPlan, viewed: Viewed) -> None:
    """Add the microscope: its objective is what the zoom makes of it."""
    instrument = ET.SubElement(root, "Instrument", ID="Instrument:0")
    ET.SubElement(
        instrument,
        "Objective",
        ID="Objective:0",
        Model=f"{folder.world.name}, simulated",
        LensNA=_number(microscope(folder, viewed).aperture),
        NominalMagnification=_number(viewed.look.view.magnification),
    )


def _image(root: ET.Element, folder: ExportedPlan, viewed: Viewed) -> None:
    """Add the image with its objective, its pixels and the link to its notes."""
    look, optics = viewed.look, folder.world.optics
    image = ET.SubElement(root, "Image", ID="Image:0", Name=look.id)
    ET.SubElement(
        image, "Description"
    ).text = (
        f"Predicted by microplan: {viewed.scene.target.name} in step {viewed.step.id}"
    )
    ET.SubElement(image, "InstrumentRef", ID="Instrument:0")
    ET.SubElement(
        image,
        "ObjectiveSettings",
        ID="Objective:0",
        Medium=_medium(optics.medium_index),
        RefractiveIndex=_number(optics.medium_index),
    )
    _pixels(image, folder, viewed)
    ET.SubElement(image, "AnnotationRef", ID="Annotation:0")


def _pixels(image: ET.Element, folder: ExportedPlan, viewed: Viewed) -> None:
    """Add the pixels' size, the light, and where the image was taken."""
    look, optics = viewed.look, folder.world.optics
    size = _number(look.view.um_per_px)
    pixels = ET.SubElement(
        image,
        "Pixels",
        ID="Pixels:0",
        DimensionOrder="XYCZT",
        Type="uint8",
        SizeX=str(optics.width_px),
        SizeY=str(optics.height_px),
        SizeC="1",
        SizeZ="1",
        SizeT="1",
        SignificantBits="8",
        Interleaved="false",
        BigEndian="false",
        PhysicalSizeX=size,
        PhysicalSizeXUnit="\N{MICRO SIGN}m",
        PhysicalSizeY=size,
        PhysicalSizeYUnit="\N{MICRO SIGN}m",
    )
    wavelength = _number(optics.wavelength_um * NM_PER_UM)
    ET.SubElement(
        pixels,
        "Channel",
        ID="Channel:0:0",
        Name="reflected light",
        SamplesPerPixel="1",
        ContrastMethod="Brightfield",
        EmissionWavelength=wavelength,
        EmissionWavelengthUnit="nm",
    )
    ET.SubElement(pixels, "TiffData", FirstC="0", FirstZ="0", FirstT="0", IFD="0",
                  PlaneCount="1")  # fmt: skip
    stage = viewed.scene.stage
    ET.SubElement(
        pixels,
        "Plane",
        TheC="0",
        TheZ="0",
        TheT="0",
        PositionX=_number(stage.x_um or 0.0),
        PositionXUnit="\N{MICRO SIGN}m",
        PositionY=_number(stage.y_um or 0.0),
        PositionYUnit="\N{MICRO SIGN}m",
        PositionZ=_number(look.view.focus_um),
        PositionZUnit="\N{MICRO SIGN}m",
    )


def _notes(root: ET.Element, folder: ExportedPlan, viewed: Viewed) -> None:
    """Add what OME has no place for as names and values."""
    look = viewed.look
    notes = {
        "plan": folder.plan.name,
        "status": folder.plan.status,
        "step": viewed.step.id,
        "look": look.id,
        "target": viewed.scene.target.name,
        "light": _number(look.view.light),
        "focus_um": _number(look.view.focus_um),
        "image_sha256": look.scene.image_sha256,
        "simulated": "true",
    }
    structured = ET.SubElement(root, "StructuredAnnotations")
    listed = ET.SubElement(
        structured, "MapAnnotation", ID="Annotation:0", Namespace=_NOTES
    )
    value = ET.SubElement(listed, "Value")
    for name, text in notes.items():
        ET.SubElement(value, "M", K=name).text = text


def _medium(index: float) -> str:
    """Return what OME-XML calls a medium of an index."""
    return next((name for n, name in _MEDIA if abs(n - index) < _NEAR), "Other")


def _legal(text: str | None) -> str | None:
    """Return text with U+FFFD for every character that XML 1.0 has no place for."""
    return None if text is None else _ILLEGAL.sub("\N{REPLACEMENT CHARACTER}", text)


def _number(value: float) -> str:
    return f"{value + 0.0:.9g}"
