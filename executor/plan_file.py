"""The plan as its file holds it: the bytes, and what they say."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from executor.errors import ExecutorError
from schemas.codec import CodecError
from schemas.plan import Plan, parse_plan


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFile:
    """A plan and the bytes it was read from."""

    plan: Plan
    source: bytes

    @property
    def sha256(self) -> str:
        """Return the hash of the bytes."""
        return hashlib.sha256(self.source).hexdigest()


def read_plan(path: Path) -> PlanFile:
    """Return the plan of a file, or raise MP802."""
    try:
        source = path.read_bytes()
    except OSError as error:
        raise ExecutorError("MP802", f"cannot read {path}: {error.strerror}") from error
    try:
        return PlanFile(plan=parse_plan(source.decode("utf-8")), source=source)
    except (UnicodeDecodeError, CodecError) as error:
        words = str(error)
        if path.suffix in (".yaml", ".yml"):
            words = f"{path} is a task, no plan: compile it first (microplan compile)"
        raise ExecutorError("MP802", words) from error
