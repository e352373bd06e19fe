"""The arguments of commands that read pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from microplan.planner.cli.argument_values import asked, depth, faces, names
from microplan.planner.measure.near import NEAR, parse_near
from microplan.planner.task.presets import PRESETS

UNITS = ("nm", "um", "mm", "inch", "m")  # that drawings may be in


def add_measure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan measure`."""
    _add_pictures(parser)
    parser.add_argument("--task", help="task.yaml, with --step")
    parser.add_argument("--step", help="id of a step that looks")
    parser.add_argument("--workcell", type=Path, help="workcell.yaml")
    _add_part(parser)
    parser.add_argument(
        "--chain",
        type=asked(names, "routines, coarse to fine, as otsu,likelihood"),
        metavar="NAME,...",
        help="routines to measure with; default: the best on the task's images",
    )
    _add_near(parser)
    parser.add_argument("--magnification", type=float, help="default: as compiled")
    parser.add_argument("--focus-um", type=float, help="world height in focus")
    _add_bits(parser)
    parser.add_argument(
        "--json", action="store_true", help="a JSON object a picture, one a line"
    )
    parser.add_argument(
        "--mark",
        type=Path,
        metavar="FOLDER",
        help="write the pictures with the target's contour where it was found",
    )
    parser.add_argument("--preset", choices=sorted(PRESETS), help="how much to spend")
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="list every gate, and all notes"
    )
    parser.set_defaults(format="text")  # of the findings


def add_calibrate(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `microplan calibrate`."""
    _add_pictures(parser)
    parser.add_argument("--workcell", type=Path, required=True, help="workcell.yaml")
    parser.add_argument(
        "-o", "--out", type=Path, help="the workcell with what was found, beside it"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="HTML page with charts and pulls"
    )
    _add_part(parser)
    _add_near(parser)
    parser.add_argument(
        "--magnification", type=float, help="default: the workcell's only one"
    )
    _add_bits(parser)
    parser.set_defaults(format="text")


def _add_near(parser: argparse.ArgumentParser) -> None:
    """Add where the target is about."""
    parser.add_argument(
        "--near",
        type=asked(parse_near, NEAR),
        metavar="X,Y[,DEG]",
        help="where the target is about: 320px,244px of the frame, or --near=-12um,3um "
        "in the world; angle in degrees; default: where the task has it, of --part "
        "anywhere",
    )


def _add_pictures(parser: argparse.ArgumentParser) -> None:
    """Add the files of pictures."""
    parser.add_argument(
        "pictures",
        nargs="+",
        type=Path,
        metavar="IMAGE",
        help="PNG or TIFF file, or a folder of them; a page of a TIFF is a picture",
    )


def _add_bits(parser: argparse.ArgumentParser) -> None:
    """Add the full scale of pictures."""
    parser.add_argument(
        "--bits",
        type=asked(depth, "a whole number from 1 to 16"),
        metavar="N",
        help="full scale of the pictures is 2**N - 1; default: that of the file, of 16 "
        "bits that of the camera",
    )


def _add_part(parser: argparse.ArgumentParser) -> None:
    """Add a part that no task describes, and how its pictures were taken."""
    parser.add_argument(
        "--part",
        type=Path,
        metavar="DRAWING",
        help="DXF or GDSII file, with --workcell, in place of a task",
    )
    parser.add_argument(
        "--target",
        metavar="KIND:LAYER",
        help="circle:LAYER, teeth:LAYER:COUNT, notch:LAYER or outline:LAYER of the "
        "part, with :RING for one of several; default: its outline",
    )
    parser.add_argument("--height-um", type=float, help="of the part; default: flat")
    parser.add_argument(
        "--units", choices=sorted(UNITS), help="of the drawing; default: as it states"
    )
    parser.add_argument(
        "--layers",
        type=asked(names, "layers of the drawing, as A,B"),
        metavar="A,B",
        help="that are the part's outline; default: the only one",
    )
    parser.add_argument(
        "--faces",
        type=asked(faces, "layers and ratios, as PADS:0.4,DOT:1.1"),
        metavar="A:RATIO,...",
        help="faces on the part: layers, reflectances over its",
    )
    parser.add_argument("--cell", help="of a GDSII file; default: the only one")
    parser.add_argument(
        "--polarity",
        choices=("bright", "dark"),
        help="of the part against what is around it; default: bright",
    )
