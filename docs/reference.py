"""Write docs/reference/ from schemas, parsers and codes: python docs/reference.py.

With --check nothing is written, and the exit status is 1 if a page is not what it
should be.
"""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
import tomllib
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from reference_cli import program
from reference_keys import key_tables, row

from microplan.executor.cli.arguments import build_parser as run_parser
from microplan.executor.devices.errors import CODES
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.world import build_world
from microplan.planner.cli.arguments import build_parser
from microplan.planner.source.diagnostics import TITLES, Report
from microplan.planner.source.source import parse
from microplan.planner.task.read_task import load_task
from microplan.schemas.codec import to_data
from microplan.schemas.files import json_schema
from microplan.schemas.files.plan_schema import schema_of
from microplan.schemas.files.world import World

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "reference"
EXAMPLES = ROOT / "examples"
TASKS = ("gear_on_shaft", "laser_die")  # examples of keys come from the first
GOLDEN = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
WIDTH = 120  # of lines of prose
MADE = "<!-- written by docs/reference.py: change that, or what it reads -->"
SUBJECTS = (
    ("MP0", "Files and syntax"), ("MP1", "Task and workcell"), ("MP2", "Drawings"),
    ("MP3", "Assembly and scenes"), ("MP4", "Optics and views"),
    ("MP5", "Routines and selection"), ("MP6", "Fit, budget and forces"),
    ("MP7", "Outputs"), ("MP8", "Execution"), ("MP9", "Pictures"),
)  # fmt: skip
READING = (
    "A table is headed by its place: NAME is a name of your choosing, `[]` any entry "
    "of a list. `needed` is a key that must be there, `-` one that may be left out and "
    "has no default. A unit of 1 is a number without one."
)


def task() -> str:
    """Return the page on task.yaml."""
    return _format("task", "The task file", "task.yaml", _yaml("task"))


def workcell() -> str:
    """Return the page on workcell.yaml."""
    return _format("workcell", "The workcell file", "workcell.yaml", _yaml("workcell"))


def station() -> str:
    """Return the page on station.toml."""
    files = sorted((EXAMPLES / "stations").glob("*.toml"), reverse=True)
    data = [tomllib.loads(file.read_text(encoding="utf-8")) for file in files]
    return _format("station", "The station file", "station.toml", data)


def plan() -> str:
    """Return the page on plan.json."""
    data = json.loads(GOLDEN.read_text(encoding="utf-8"))
    return _format("plan", "The plan", "plan.json", [data])


def world() -> str:
    """Return the page on world.json."""
    data = []
    for name in TASKS:
        report = Report()
        found = load_task(EXAMPLES / name / "task.yaml", report)
        if found is None:
            raise ValueError(f"{name} cannot be read: {report.found}")
        data.append(to_data(build_world(found, initial(found))))
    schema = schema_of(World, "microplan world")
    text = (
        "`world.json` of a plan folder is what the simulated cell starts from. A live "
        "run works with it deleted."
    )
    return _page("The simulated world: every key", text, schema, data)


def outlines() -> str:
    """Return the page on what `microplan export --to json` writes."""
    return _format("outlines", "Predicted outlines", "outlines.json", [])


def cli() -> str:
    """Return the page on both programs."""
    text = (
        "Results go to standard output, findings and progress to standard error. "
        "[Exit statuses](../conventions.md#exit-statuses) are the same for every "
        "`--format`."
    )
    anything: Mapping[str, Callable[..., int]] = defaultdict(lambda: len)
    blocks = [program(build_parser(anything)), program(run_parser())]
    return "\n\n".join(["# The command line", MADE, text, *blocks]) + "\n"


def diagnostics() -> str:
    """Return the page with every code in one line."""
    text = (
        "Every code has a page of its own with an example and how to mend it; "
        "`microplan explain CODE` shows it. [Conventions of those pages]"
        "(../diagnostics/README.md)."
    )
    titles = {**TITLES, **{code: title for code, (title, _) in CODES.items()}}
    blocks = ["# Diagnostics: every code", MADE, text]
    for prefix, subject in SUBJECTS:
        run = prefix == "MP8"
        heads = ["code", "says", *(["exit status"] * run)]
        lines = [f"## {prefix}xx: {subject}", "", row(heads), "|---" * len(heads) + "|"]
        for code in sorted(code for code in titles if code.startswith(prefix)):
            cells = [f"[{code}](../diagnostics/{code}.md)", titles[code]]
            lines.append(row([*cells, *([str(CODES[code][1])] if run else [])]))
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n"


PAGES: Mapping[str, Callable[[], str]] = {
    "task": task, "workcell": workcell, "station": station, "plan": plan,
    "world": world, "outlines": outlines, "cli": cli, "diagnostics": diagnostics,
}  # fmt: skip


def _yaml(name: str) -> list[Any]:
    """Return the examples' data of one kind of file."""
    found = []
    for folder in TASKS:
        file = EXAMPLES / folder / f"{name}.yaml"
        source = parse(file.read_text(encoding="utf-8"), file, file.name, Report())
        if source is None:
            raise ValueError(f"{file} cannot be read")
        found.append(source.data)
    return found


def _format(name: str, title: str, file: str, data: list[Any]) -> str:
    """Return the page on a format that has a schema."""
    text = f"Every key of `{file}`. `microplan schema {name}` prints the JSON Schema."
    return _page(f"{title}: every key", text, json_schema.load(name), data)


def _page(title: str, text: str, schema: Mapping[str, Any], data: list[Any]) -> str:
    """Return a page on a format."""
    blocks = [f"# {title}", MADE, text, READING, key_tables(schema, data)]
    return "\n\n".join(blocks) + "\n"


def _wrapped(page: str) -> str:
    """Return a page whose lines of prose are at most `WIDTH` characters long."""
    lines: list[str] = []
    fenced = False
    for line in page.split("\n"):
        fenced ^= line.startswith("```")
        if fenced or len(line) <= WIDTH or line.startswith("|"):
            lines.append(line)
        else:
            indent = "  " if line.startswith("- ") else ""
            lines += textwrap.wrap(
                line, WIDTH, subsequent_indent=indent,
                break_long_words=False, break_on_hyphens=False,
            )  # fmt: skip
    return "\n".join(lines)


def main() -> int:
    """Write the pages, or tell which are not what they should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing")
    checking = parser.parse_args().check
    wrong = []
    for name, page in PAGES.items():
        file, text = FOLDER / f"{name}.md", _wrapped(page())
        if not checking:
            FOLDER.mkdir(exist_ok=True)
            file.write_text(text, encoding="utf-8", newline="\n")
        elif not file.is_file() or file.read_text(encoding="utf-8") != text:
            wrong.append(file.name)
    for name in wrong:
        print(f"docs/reference/{name} is old: python docs/reference.py renews it")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
