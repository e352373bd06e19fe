"""What reports show of a look, with its pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from microplan.planner.store.pictures import Picture
from microplan.schemas.files import evidence as shown


@dataclass(frozen=True, slots=True, kw_only=True)
class LookFigures:
    """What reports show of a look, with its pictures by their path in the folder."""

    evidence: shown.LookEvidence
    pictures: Mapping[str, Picture]
