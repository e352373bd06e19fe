"""Sweeps and compiles on a local Dask cluster of two workers: the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from microplan.planner.cli.main import main
from microplan.planner.sweep.sweeping import ROWS
from tests.planner.sweep.no_looks import no_looks, readings, swept

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow  # clusters take seconds to begin and to end

SERVER = """
import sys
from tests.planner.queue.local_cluster import local_cluster
if __name__ == "__main__":
    cluster = local_cluster(2)
    pids = [each.pid for each in cluster.workers.values()]
    print(cluster.scheduler_address, *pids, flush=True)
    sys.stdin.read()
    cluster.close()
"""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Yield a process with a scheduler; it prints its address and its workers' pids."""
    script = tmp_path / "server.py"
    script.write_text(SERVER)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([".", *sys.path])}
    with subprocess.Popen(
        [sys.executable, str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=env,
    ) as process:
        yield process
        assert process.stdin is not None
        if process.poll() is None:
            process.stdin.close()
        process.wait(30)


def told(server: subprocess.Popen[str]) -> tuple[str, list[int]]:
    """Return what a server prints."""
    assert server.stdout is not None
    address, *pids = server.stdout.readline().split()
    return address, [int(pid) for pid in pids]


def test_a_cluster_makes_the_same_rows_and_plans(
    server: subprocess.Popen[str], tmp_path: Path
) -> None:
    task, (address, _) = no_looks(tmp_path / "task"), told(server)
    here = swept(task, tmp_path / "here")
    assert swept(task, tmp_path / "there", scheduler=address) == here
    plans = []
    for name, words in (("a", ()), ("b", ("--scheduler", address))):
        plans.append(tmp_path / f"{name}.plan")
        out = ("-o", str(plans[-1]), "--no-cache")
        assert main(["compile", str(task), *out, *words]) == 0
    first, second = ((plan / "plan.json").read_bytes() for plan in plans)
    assert first == second


def test_a_killed_worker_costs_time_only(
    server: subprocess.Popen[str], tmp_path: Path
) -> None:
    task, (address, pids) = no_looks(tmp_path / "task"), told(server)
    here = swept(task, tmp_path / "here")
    os.kill(pids[0], signal.SIGKILL)
    assert swept(task, tmp_path / "there", scheduler=address) == here


def test_a_scheduler_that_dies_loses_no_finished_row(
    server: subprocess.Popen[str], tmp_path: Path
) -> None:
    task, (address, _) = no_looks(tmp_path / "task"), told(server)
    out = tmp_path / "out"
    swept(task, tmp_path / "here")  # drawings are read
    words = ["--set", f"seed={','.join(map(str, range(20)))}"]
    words += [
        "--set",
        f"environment.humidity={','.join(f'.{n}' for n in range(11, 31))}",
    ]
    call = [sys.executable, "-m", "microplan.planner.cli.main", "sweep", str(task)]
    call += [*words, "-o", str(out), "--cache", str(readings()), "--format", "json"]
    with subprocess.Popen(
        [*call, "--scheduler", address], stdout=subprocess.PIPE, text=True
    ) as sweep:
        while not (out / ROWS).exists() or (out / ROWS).stat().st_size < 4000:
            assert sweep.poll() is None
            time.sleep(0.05)
        kept = (out / ROWS).read_bytes()
        server.kill()
        said = sweep.communicate(timeout=60)[0]
    assert sweep.returncode == 2
    assert "MP731" in {each["code"] for each in json.loads(said)["findings"]}
    rows = (out / ROWS).read_bytes()
    assert rows.startswith(kept[: kept.rindex(b"\n")])
    assert len(rows.splitlines()) < 400
    assert all(json.loads(line)["plan_sha256"] for line in rows.splitlines())
