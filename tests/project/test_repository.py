"""What every file of the repository keeps to."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TARGETS = ("install", "demo", "check", "test", "bench")

# The pieces are joined here, so that this file is not its own first offender.
HOSTS = (
    ("pypi", "org"),
    ("pythonhosted", "org"),
    ("npmjs", "org"),
    ("anaconda", "org"),
)
FOLDERS = (
    ("", "home", ""),
    ("", "Users", ""),
    ("", "root", ""),
    ("", "work", ""),
    ("..", "shared"),
)
NO_HOST = re.compile("|".join(re.escape(".".join(words)) for words in HOSTS))
NO_PATH = re.compile("|".join(re.escape("/".join(words)) for words in FOLDERS))
LOCKS = {
    "uv.lock",
    "poetry.lock",
    "pdm.lock",
    "Pipfile.lock",
    "pixi.lock",
    "pylock.toml",
}
LINK = re.compile(r"!?\[[^\]]*\]\(\s*<?([^)\s>]+)>?[^)]*\)")


def _tracked() -> list[Path]:
    """Return the repository's files; without git, what is not ignored by habit."""
    git = shutil.which("git")
    if git is not None and (ROOT / ".git").exists():
        done = subprocess.run(
            [git, "ls-files", "-z"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        found = [ROOT / name for name in done.stdout.split("\0") if name]
    else:  # an unpacked source archive
        found = [p for p in ROOT.rglob("*") if not _habitual(p.relative_to(ROOT))]
    return sorted(p for p in found if p.is_file())


def _habitual(path: Path) -> bool:
    """Return whether a path is a cache, an environment or a build's output."""
    return any(
        part.startswith(".") or part in {"build", "dist", "__pycache__"}
        for part in path.parts
    )


FILES = _tracked()
TEXTS = [(p, p.read_bytes()) for p in FILES]


def _offenders(pattern: re.Pattern[str]) -> list[str]:
    """Return file:line of every match in a text file."""
    return [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path, raw in TEXTS
        if b"\0" not in raw
        for number, line in enumerate(raw.decode("utf-8").splitlines(), 1)
        if pattern.search(line)
    ]


def test_the_repository_is_not_empty() -> None:
    assert len(FILES) > 100


def test_no_file_names_the_host_of_a_package_registry() -> None:
    assert _offenders(NO_HOST) == []


def test_no_file_names_a_path_of_somebodys_machine() -> None:
    assert _offenders(NO_PATH) == []


def test_there_are_no_lock_files() -> None:
    assert [p.name for p in FILES if p.name in LOCKS] == []


def test_text_ends_with_one_newline_and_has_no_carriage_returns() -> None:
    kinds = {".py", ".md", ".toml", ".yaml", ".json"}
    odd = [
        str(path.relative_to(ROOT))
        for path, raw in TEXTS
        if path.suffix in kinds and raw
        and (not raw.endswith(b"\n") or raw.endswith(b"\n\n") or b"\r" in raw)
    ]  # fmt: skip
    assert odd == []


def test_the_changelog_has_a_place_for_what_is_new() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## Unreleased$", text, re.MULTILINE)


def test_make_knows_its_targets() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in TARGETS:
        assert re.search(rf"^{target}:", text, re.MULTILINE), target


def test_the_packages_of_the_wheel_are_those_that_are_checked() -> None:
    with (ROOT / "pyproject.toml").open("rb") as stream:
        tool = tomllib.load(stream)["tool"]
    build = tool["hatch"]["build"]
    links = {link.name for link in (ROOT / "microplan").iterdir() if link.is_symlink()}
    assert all(
        (ROOT / "microplan" / name).readlink() == Path("..", name) for name in links
    )
    assert {f"/microplan/{name}" for name in links} == set(build["exclude"])
    wheel = build["targets"]["wheel"]
    assert {"microplan", *links} <= set(wheel["only-include"])
    assert all(wheel["sources"][name] == f"microplan/{name}" for name in links)
    assert tool["importlinter"]["root_package"] == "microplan"
    assert "microplan" in tool["mypy"]["packages"]
    lint = tool["ruff"]["lint"]
    assert links == set(lint["flake8-tidy-imports"]["banned-api"])
    assert all((ROOT / name / "py.typed").is_file() for name in links)


@pytest.mark.parametrize(
    "page",
    [p for p in FILES if p.suffix == ".md"],
    ids=lambda p: p.relative_to(ROOT).as_posix(),
)
def test_links_to_files_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in LINK.findall(text):
        if re.match(r"[a-z]+:", target):  # another site
            continue
        file, _, anchor = target.partition("#")
        found = page if not file else page.parent / file
        assert found.exists(), target
        if anchor and found.suffix == ".md":
            assert anchor in _anchors(found), target


def _anchors(page: Path) -> set[str]:
    """Return the anchors that headings of a Markdown page get."""
    lines = page.read_text(encoding="utf-8").splitlines()
    heads = [line.lstrip("#").strip() for line in lines if line.startswith("#")]
    plain = (re.sub(r"[^\w\- ]", "", head.lower()) for head in heads)
    return {head.replace(" ", "-") for head in plain}
