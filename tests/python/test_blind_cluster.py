"""A campaign on a real Dask cluster of two workers, one of them killed midway: nothing is lost.

The diagnosis is replaced by a stub that takes half a second and says which process it was; everything else is the campaign's own code."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import blind_sets as sets
import pytest

from wineglass import cli
from wineglass.blind import results, running
from wineglass.blind.scheduling import Spread

HERE = Path(__file__).resolve().parent
CASES = 16


@pytest.fixture
def cluster(tmp_path):
    """Address of the scheduler and two worker processes, each a program of its own without a nanny that would start it again."""
    paths = os.pathsep.join([str(HERE), str(HERE.parents[1] / "tools")])
    environment = {**os.environ, "PYTHONPATH": paths, "BLIND_STUB_S": "0.5", "DASK_DISTRIBUTED__LOGGING__DISTRIBUTED": "error"}
    file = tmp_path / "scheduler.json"
    common = {"env": environment, "cwd": tmp_path, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    scheduler = subprocess.Popen(command, **common)
    while not file.is_file() and scheduler.poll() is None:
        time.sleep(0.05)
    workers = [subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--no-nanny", "--nthreads", "1",
                                 "--no-dashboard", "--local-directory", str(tmp_path / f"worker{i}")], **common) for i in range(2)]
    try:
        import json

        yield json.loads(file.read_text())["address"], workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_nothing_is_lost_when_one_of_two_workers_is_killed(cluster, tmp_path):
    from distributed import Client

    address, workers = cluster
    with Client(address, timeout=60) as client:
        client.wait_for_workers(2, timeout=60)
    folders = sets.sealed_set(tmp_path / "set", [sets.label(sets.sheet(f"case_{i:04d}", "null")) for i in range(1, CASES + 1)])
    target, killed_after = folders.results("diagnose"), []

    def kill():
        while True:
            pids = {one["machine"] for one in results.read(target).values()} if target.is_dir() else set()
            if str(workers[0].pid) in pids and len(pids) == 2:
                workers[0].send_signal(signal.SIGKILL)
                killed_after.append(len(list(target.glob("case_*.json"))))
                return
            time.sleep(0.02)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    running.run(folders, "diagnose", Spread(scheduler=address), work=sets.stub)
    thread.join(10)
    workers[0].wait(10)
    found = results.read(target)
    assert killed_after and killed_after[0] < CASES, "the worker outlived the campaign"
    assert {name: one["seen"] for name, one in found.items()} == {f"case_{i + 1:04d}": f"recording {i}" for i in range(CASES)}
    assert sum(one["machine"] == str(workers[1].pid) for one in found.values()) > CASES // 2


def test_the_table_has_every_case(tmp_path):
    import pyarrow.parquet as parquet

    folders = sets.sealed_set(tmp_path / "set", [sets.label(sets.sheet(f"case_{i:04d}", "null")) for i in range(1, 4)])
    path = running.run(folders, "diagnose", Spread(0), work=sets.stub)
    table = parquet.read_table(path).to_pydict()
    assert table["case"] == ["case_0001", "case_0002", "case_0003"] and table["verdict"] == ["no_gap"] * 3 and table["p_none"] == [1.0] * 3


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path, capsys, monkeypatch):
    from wineglass.blind import scheduling

    monkeypatch.setattr(scheduling, "CONNECT_S", 1)
    folders = sets.sealed_set(tmp_path / "set", [sets.label(sets.sheet("case_0001", "null"))])
    assert cli.main(["blind", "run", str(folders.root), "--scheduler", "tcp://127.0.0.1:9"]) == 2
    error = capsys.readouterr().err
    assert "tcp://127.0.0.1:9" in error and "no scheduler answers" in error


def test_a_missing_package_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    folders = sets.sealed_set(tmp_path / "set", [sets.label(sets.sheet("case_0001", "null"))])
    assert cli.main(["blind", "run", str(folders.root)]) == 2
    error = capsys.readouterr().err
    assert "distributed" in error and "wineglass[blind]" in error and error.count("\n") == 1
