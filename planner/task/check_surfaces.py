"""Checks of walls and faces: intervals that run backwards."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import Checked
from microplan.planner.task.check_workcell import report_backwards


def check_surfaces(checked: Checked, report: Report, *sections: str) -> None:
    """Report intervals of walls and faces that run backwards.

    `sections` are the keys of the file that hold bodies by name.
    """
    for where in _bodies(checked, sections):
        for key in (("wall", "reflectance"), ("finish",)):
            if checked.good(*where, *key):
                value = checked.source.get(*where, *key)
                if isinstance(value, list):
                    report_backwards(
                        checked.source, (*where, *key), value[0], value[1], report
                    )


def _bodies(checked: Checked, sections: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield where bodies are described, posts after their part."""
    for section in sections:
        for name in sorted(checked.source.mapping(section)):
            yield (section, name)
            for post in sorted(checked.source.mapping(section, name, "posts")):
                yield (section, name, "posts", post)
