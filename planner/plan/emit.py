"""Serialisation of a compile to the bytes of a plan folder."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from microplan.planner.looks.evidence import LookFigures
from microplan.planner.store.folder import PLAN, PlanBytes, json_bytes
from microplan.planner.store.pictures import Picture
from microplan.planner.store.summary import plan_summary
from microplan.schemas.codec import to_data
from microplan.schemas.files import evidence as shown
from microplan.schemas.files.evidence import Scenes
from microplan.schemas.files.world import World
from microplan.schemas.plan import Plan, dump_plan

# Enough that rings written as numbers still close when they are read again.
WORLD_DIGITS = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFiles:
    """Everything that goes into a plan folder."""

    plan: Plan
    world: World
    scenes: Scenes
    images: Mapping[str, Picture]  # path in the folder -> (rows, columns) 8 bit
    arrays: Mapping[str, Mapping[str, npt.NDArray[np.float32]]]  # npz path -> arrays
    timings: Mapping[str, float]  # stage -> seconds; never compared
    inputs: Mapping[str, object]  # raw-file hashes and versions; never compared
    figures: tuple[LookFigures, ...] = ()  # what reports show of each look


def plan_bytes(made: PlanFiles) -> PlanBytes:
    """Return the plan folder of a compile; the same values give the same bytes.

    Raises
    ------
    ValueError
        If a picture cannot be encoded.
    """
    files = {
        PLAN: dump_plan(made.plan).encode("utf-8"),
        "world.json": json_bytes(to_data(made.world, WORLD_DIGITS)),
        "scenes.json": json_bytes(to_data(made.scenes, WORLD_DIGITS)),
        "inputs.json": json_bytes(dict(made.inputs)),
    }
    files.update(_pictures(made.images))
    for figures in made.figures:
        path = f"{shown.FOLDER}/{figures.evidence.look}.json"
        files[path] = json_bytes(to_data(figures.evidence))
        files.update(_pictures(figures.pictures))
    files.update({name: _arrays(held) for name, held in made.arrays.items()})
    return PlanBytes(
        name=made.plan.name,
        files=files,
        timings=made.timings,
        summary=plan_summary(made.plan),
    )


def _pictures(pictures: Mapping[str, Picture]) -> Iterator[tuple[str, bytes]]:
    """Yield pictures as PNG by their paths in a folder."""
    for name, pixels in pictures.items():
        ok, data = cv2.imencode(".png", pixels)
        if not ok:
            raise ValueError(f"{name} could not be encoded")
        yield name, data.tobytes()


def _arrays(held: Mapping[str, npt.NDArray[np.float32]]) -> bytes:
    """Return arrays as an npz file."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **{k: held[k] for k in sorted(held)})
    return stream.getvalue()
