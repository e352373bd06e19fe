"""Completion scripts, in the shells that they are for."""

from __future__ import annotations

import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from microplan.executor.cli.arguments import MODES
from microplan.planner.task.presets import PRESETS
from tests.planner.examples import ROOT

COMMANDS = {
    "microplan": ("microplan.planner.cli.main", ("completion",)),
    "microplan-run": ("microplan.executor.cli.main", ("--completion",)),
}
# what is typed -> what is offered, at least; "" begins a new word
OFFERS: list[tuple[list[str], set[str]]] = [
    (["microplan", "com"], {"compile", "completion"}),
    (["microplan", "compile", "--pre"], {"--preset"}),
    (["microplan", "compile", "--preset", ""], set(PRESETS)),
    (["microplan", "export", "a.plan", "--to", "o"], {"ome-tiff"}),
    (["microplan", "explain", "MP10"], {"MP101", "MP104"}),
    (["microplan", "explain", "MP82"], {"MP820"}),
    (["microplan", "compile", "exampl"], {"examples"}),
    (["microplan-run", "--mo"], {"--mode"}),
    (["microplan-run", "a.plan", "--mode", ""], set(MODES)),
    (["microplan-run", "--station", "exampl"], {"examples"}),
]
# Called as bash does it when Tab is pressed: words, the current one's number.
BASH = r"""
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
how=$(complete -p "$1"); how=${how##*-F }; how=${how%% *}
"$how" "$1" "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\n' "${COMPREPLY[@]}"
"""
DEADLINE_S = 60.0  # a hung shell; else it takes a tenth of a second


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the commands print, as COMMAND.SHELL."""
    folder = tmp_path_factory.mktemp("completion")
    for command, (module, words) in COMMANDS.items():
        for shell in ("bash", "zsh", "fish"):
            done = subprocess.run(
                [sys.executable, "-m", module, *words, shell],
                capture_output=True, text=True, check=True, cwd=ROOT,
            )  # fmt: skip
            assert done.stderr == ""
            (folder / f"{command}.{shell}").write_text(done.stdout, encoding="utf-8")
    return folder


def has(shell: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(shutil.which(shell) is None, reason=f"no {shell} here")


@has("bash")
@pytest.mark.parametrize(
    ("typed", "offered"),
    OFFERS,
    ids=lambda v: " ".join(sorted(v) if isinstance(v, set) else v),
)
def test_bash_offers(typed: list[str], offered: set[str], scripts: Path) -> None:
    script = scripts / f"{typed[0]}.bash"
    done = subprocess.run(
        ["bash", "--norc", "--noprofile", "-c", BASH, "bash", str(script), *typed],
        capture_output=True, text=True, check=True, cwd=ROOT, timeout=DEADLINE_S,
    )  # fmt: skip
    assert done.stderr == ""
    found = set(done.stdout.split())
    assert found >= offered
    assert all(word.startswith(typed[-1]) for word in found)


@has("fish")
@pytest.mark.parametrize(
    ("typed", "offered"),
    OFFERS,
    ids=lambda v: " ".join(sorted(v) if isinstance(v, set) else v),
)
def test_fish_offers(typed: list[str], offered: set[str], scripts: Path) -> None:
    script, line = scripts / f"{typed[0]}.fish", " ".join(typed)
    done = subprocess.run(
        ["fish", "--no-config", "-c", f"source '{script}'; complete -C '{line}'"],
        capture_output=True, text=True, check=True, cwd=ROOT, timeout=DEADLINE_S,
        env={**os.environ, "HOME": str(scripts), "XDG_CONFIG_HOME": str(scripts)},
    )  # fmt: skip
    found = {row.partition("\t")[0].rstrip("/") for row in done.stdout.splitlines()}
    assert found >= offered


@has("zsh")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [offer for offer in OFFERS if len(offer[1]) == 1],
    ids=lambda v: " ".join(sorted(v) if isinstance(v, set) else v),
)
def test_zsh_types_the_rest(
    typed: list[str], offered: set[str], scripts: Path, tmp_path: Path
) -> None:
    """What is typed lacks the end of the only offer, which zsh adds after Tab."""
    shutil.copy(scripts / f"{typed[0]}.zsh", tmp_path / f"_{typed[0]}")
    (offer,) = offered
    begin = f"fpath=('{tmp_path}' $fpath); autoload -Uz compinit; compinit -D -u"
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(ROOT)
        os.environ.update(HOME=str(tmp_path), TERM="dumb", PS1="")
        os.execvp("zsh", ["zsh", "-f", "-i"])
    try:
        os.write(terminal, f"{begin}; echo re''ady\n".encode())
        until(terminal, "\nready")
        os.write(terminal, f"{' '.join(typed)}\t".encode())
        until(terminal, offer)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(terminal)


def until(terminal: int, text: str) -> None:
    """Read what a terminal shows until a text is in it."""
    said, end = "", time.monotonic() + DEADLINE_S
    while text not in said:
        left = max(end - time.monotonic(), 0.0)
        ready, _, _ = select.select([terminal], [], [], left)
        assert ready, f"{text!r} is not in {said!r}"
        said += os.read(terminal, 4096).decode("utf-8", "replace")


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_without_shtab_the_extra_is_named(command: str) -> None:
    module, words = COMMANDS[command]
    script = (
        "import sys; sys.modules['shtab'] = None\n"
        f"from {module} import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *words, "bash"],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 2
    assert "microplan[completion]" in done.stderr
    assert done.stdout == ""
