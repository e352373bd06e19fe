"""One executor at a time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.run_folder import held

HOLD = """
import sys, time
from pathlib import Path
from microplan.executor.record.run_folder import held
with held(Path(sys.argv[1]), "it"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_one_is_refused_and_told_who_holds_it(tmp_path: Path) -> None:
    path = tmp_path / "station.toml.lock"
    words = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ExecutorError) as caught, held(path, "station X"):
            pass
        assert caught.value.code == "MP861"
        told = f"station X is held by process {other.pid} on {os.uname().nodename}"
        assert caught.value.message == told
        other.send_signal(signal.SIGKILL)
    with held(path, "station X"):  # what is dead holds nothing
        assert path.read_text(encoding="utf-8").split()[1] == str(os.getpid())
    with held(path, "station X"):
        pass


def test_the_same_process_does_not_get_it_twice(tmp_path: Path) -> None:
    with (
        held(tmp_path / "lock", "run"),
        pytest.raises(ExecutorError, match="run is held by"),
        held(tmp_path / "lock", "run"),
    ):
        pass


def test_a_lock_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    with pytest.raises(ExecutorError) as caught, held(tmp_path / "no" / "lock", "x"):
        pass
    assert caught.value.code == "MP804"
