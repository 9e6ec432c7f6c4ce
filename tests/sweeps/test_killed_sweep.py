"""Sweeps whose processes are killed: nothing that was done is lost, and a variant that kills is a failure."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.sweeps import crew
from graspfx.sweeps.chunk import SweepError
from graspfx.sweeps.crew import KILLS
from graspfx.sweeps.run_sweep import SweepWarning

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes are killed by signals")
VALUES = {"coupling.external.stiffness": [20.0, 30.0, 40.0, 50.0, 60.0], "object.viscosity": [0.4, 0.8]}
DEADLY = """
import os, signal
import numpy as np

class Deadly:
    def __init__(self, rest, deadly):
        self.rest, self.deadly, n = rest, deadly, len(rest)
        self.stiffness, self.damping = 60.0 * np.eye(n)[None], 0.5 * np.eye(n)[None]

    def target(self, time):
        if self.deadly and time > 0.02:
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.9 * self.rest, np.zeros_like(self.rest)

def hold(rest, deadly=0):
    return Deadly(rest, deadly)
"""
SCENE = """
dimensions = 1
period = 0.005
duration = 0.1
engine = "interpreted"
object = { mass = 0.1, viscosity = 0.8, shape = { kind = "box", size = [0.05] } }
coupling = { external = { stiffness = 30.0 }, internal = { stiffness = 70.0, damping = 0.1 } }
hand = [{ name = "own", kind = "deadly.py" }]
finger = [
    { start = [-0.0251], device = { name = "simulated", mass = 0.15, damping = 0.2 }, hand = "own" },
    { start = [0.0252], device = { name = "simulated", mass = 0.15, damping = 0.2 }, hand = "own" },
]
"""
SWEEP = """
import sys
import graspfx as gx
if __name__ == "__main__":
    gx.sweep("reference-1dof", {values}, out=sys.argv[1], duration=0.2, chunk=1, executor={executor!r})
"""


def wait_for(folder: Path, count: int, process: subprocess.Popen[str]) -> None:
    until = time.monotonic() + 120.0
    while len(list(folder.glob("chunks/*.nc"))) < count:
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.005)


@pytest.fixture
def deadly(tmp_path: Path) -> Path:
    (tmp_path / "deadly.py").write_text(DEADLY)
    (tmp_path / "deadly.toml").write_text(SCENE)
    return tmp_path / "deadly.toml"


def test_a_parent_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    script, out = tmp_path / "sweep.py", tmp_path / "out"
    script.write_text(SWEEP.format(values=VALUES, executor=None))
    process = subprocess.Popen([sys.executable, str(script), str(out)], text=True)
    wait_for(out, 2, process)
    process.kill()
    process.wait()
    done = {path.name: path.stat().st_mtime_ns for path in out.glob("chunks/*.nc")}
    result = gx.sweep("reference-1dof", VALUES, out=out, duration=0.2)
    after = {path.name: path.stat().st_mtime_ns for path in out.glob("chunks/*.nc")}
    assert 2 <= len(done) < 10 and result.resumed == len(done)
    assert {name: after[name] for name in done} == done and len(after) == 10
    batch = gx.run_batch("reference-1dof", VALUES, 0.2)
    for quantity, by_name in batch.measures.items():
        for name, values in by_name.items():
            assert (values + 0.0).tobytes() == result[quantity][name].tobytes()


def test_processes_that_are_killed_are_replaced_and_a_variant_that_kills_is_a_failure(deadly: Path) -> None:
    values = {"hand.own.deadly": [0, 0, 0, 0, 1, 0]}
    with pytest.warns(SweepWarning) as notes:
        result = gx.sweep(deadly, values, executor="processes:1", chunk=2, out=deadly.parent / "out")
    assert [str(each.message) for each in notes] == [
        "one of 2 variants killed a process: these variants are run in smaller chunks", f"variant 4: {KILLS}",
    ]  # fmt: skip
    assert result.failure.tolist() == ["", "", "", "", KILLS, ""]
    alive = np.isfinite(result["finger_force"]["peak"]).all(axis=(1, 2))
    assert alive.tolist() == [True, True, True, True, False, True]
    assert gx.sweep(deadly, values, out=deadly.parent / "out").resumed == 6


def test_an_executor_that_breaks_ends_the_sweep_and_says_so(deadly: Path) -> None:
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        pytest.raises(SweepError, match="a process of the executor died"),
    ):
        gx.sweep(deadly, {"hand.own.deadly": [1]}, executor=pool)


def test_a_script_without_its_guard_is_told(tmp_path: Path) -> None:
    script = tmp_path / "sweep.py"
    script.write_text(SWEEP.format(values=VALUES, executor="processes:1").replace('__name__ == "__main__"', "True"))
    done = subprocess.run([sys.executable, str(script), str(tmp_path / "out")], capture_output=True, text=True)
    assert done.returncode == 1 and '`if __name__ == "__main__":`' in done.stderr


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    script, out = tmp_path / "sweep.py", tmp_path / "out"
    text = SWEEP.format(values=VALUES, executor="processes:1").replace("duration=0.2", "duration=2000.0")
    script.write_text(text)
    process = subprocess.Popen([sys.executable, str(script), str(out)], text=True)
    children: list[int] = []
    until = time.monotonic() + 120.0
    while not children and time.monotonic() < until:
        children = [pid for pid in of_parent(process.pid) if b"spawn_main" in command(pid)]
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    while any(b"spawn_main" in command(pid) for pid in children) and time.monotonic() < until:
        time.sleep(0.02)
    assert children and not any(b"spawn_main" in command(pid) for pid in children)


def of_parent(pid: int) -> list[int]:
    """List the processes that one has started."""
    try:
        return [int(text) for text in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def command(pid: int) -> bytes:
    """Read the command line of a process; nothing of one that has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def test_a_cluster_of_this_machine_gives_the_same() -> None:
    pytest.importorskip("distributed", reason="the cluster: pip install 'graspfx[cluster]'")
    values = {"coupling.external.stiffness": [20.0, 40.0]}
    result = gx.sweep("reference-1dof", values, executor="local:1", duration=0.1, chunk=1)
    batch = gx.run_batch("reference-1dof", values, 0.1)
    assert (result["finger_force"]["rms"] == batch["finger_force"]["rms"]).all() and not result.failed.any()


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_cluster_of_somebody_else_is_reached_by_its_address_or_its_client(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="the cluster: pip install 'graspfx[cluster]'")
    values = {"coupling.external.stiffness": [20.0, 40.0, 50.0]}
    batch = gx.run_batch("reference-1dof", values, 0.1)
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
        ) as cluster,
        distributed.Client(cluster) as client,
    ):  # fmt: skip
        for executor in (cluster.scheduler_address, client):
            result = gx.sweep("reference-1dof", values, executor=executor, duration=0.1, chunk=1)
            assert (result["finger_force"]["rms"] == batch["finger_force"]["rms"]).all() and not result.failed.any()
        assert client.submit(int, 1).result() == 1
    monkeypatch.setattr(crew, "PATIENCE", 0.5)
    with pytest.raises(InputError, match="a reachable dask scheduler"):
        gx.sweep("reference-1dof", values, executor="tcp://127.0.0.1:1", duration=0.1)
