"""Artifacts of a plan's routines: what they measure with, read from the plan folder."""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station_file import stays_in
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.schemas.plan import Look, Measure, Plan, RoutineUse

Stages = Sequence[tuple[str, Artifact]]


class Artifacts:
    """Chains ready for `microplan.featuresel.routines.chain.measure_chain`.

    `sha256` is of the files that the arrays were read from, in the plan's order.
    """

    def __init__(
        self, found: Mapping[tuple[str, str | None], Artifact], sha256: str = ""
    ) -> None:
        self._found = dict(found)
        self.sha256 = sha256

    @classmethod
    def from_folder(cls, plan: Plan, folder: Path) -> Artifacts:
        """Read what `plan` names under `folder` and check the routines' versions.

        Raises
        ------
        ExecutorError
            MP803 if a file is missing or damaged; MP810 if a routine is not installed
            or of another version.
        """
        found: dict[tuple[str, str | None], Artifact] = {}
        digest = hashlib.sha256()
        for step in plan.steps:
            for look in step.looks:
                for measure in look.measures:
                    key = key_of(look, measure)
                    for use in (*measure.chain, *measure.fallback):
                        _check_version(use)
                        found[key, use.arrays or use.id] = _read(use, folder, digest)
        return cls(found, digest.hexdigest())

    def stages(self, key: str, uses: Sequence[RoutineUse]) -> Stages:
        """Return the routines of one chain, coarse to fine; `key` is `key_of` its
        feature."""
        return [(use.id, self._found[key, use.arrays or use.id]) for use in uses]


def answer_of(image: FloatArray, stages: Stages, start: Guess) -> Measurement | Failure:
    """Return the answer of a chain of routines on an image, (rows, columns), 0..1.

    Raises
    ------
    ExecutorError
        MP803 if it fails on the numbers and arrays that the plan folder gives it, or
        answers with what is no number: a routine that finds nothing returns a failure.
    """
    names = " > ".join(name for name, _ in stages)
    try:
        found = measure_chain(image, stages, start)
    except Exception as error:
        kind = type(error).__name__
        raise ExecutorError(
            "MP803",
            f"{names} cannot use the numbers and arrays that the plan gives it: "
            f"{kind}: {error}",
        ) from error
    if isinstance(found, Failure):
        return found
    for each in fields(found):
        value = getattr(found, each.name)
        if value is not None and not math.isfinite(value):
            raise ExecutorError(
                "MP803",
                f"{names} answers {each.name} = {value} by the numbers and arrays "
                "that the plan gives it",
            )
    return found


def key_of(look: Look, measure: Measure) -> str:
    """Return the key of the artifacts of a look's feature."""
    return f"{look.id}.{measure.feature}" if measure.feature else look.id


def _check_version(use: RoutineUse) -> None:
    """Refuse a routine that is not the one the plan was measured with."""
    if use.id not in REGISTRY:
        raise ExecutorError("MP810", f"the plan needs routine {use.id!r}")
    installed = load(use.id).version
    if installed != use.version:
        raise ExecutorError(
            "MP810",
            f"routine {use.id} is version {installed}, the plan needs {use.version}",
        )


def _read(use: RoutineUse, folder: Path, digest: hashlib._Hash) -> Artifact:
    """Return one routine's numbers and arrays; what was read goes into the digest."""
    if use.arrays is None:
        return Artifact(parameters=use.parameters)
    path = folder / use.arrays
    if not stays_in(path, folder):
        raise ExecutorError("MP803", f"{use.arrays} leaves the plan folder")
    try:
        source = path.read_bytes()
        digest.update(source)
        with np.load(io.BytesIO(source), allow_pickle=False) as data:
            arrays = {name: np.asarray(data[name]) for name in data.files}
    except Exception as error:  # of zip, zlib, tokenize, a lack of memory: all of it
        raise ExecutorError("MP803", f"{use.arrays}: {error}") from error
    return Artifact(parameters=use.parameters, arrays=arrays)
