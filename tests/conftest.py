"""Setting of every test: figures without a display, no cache of the user's, the same examples every time."""

from __future__ import annotations

import atexit
import os
import signal
from functools import partial
from shutil import rmtree
from tempfile import mkdtemp

import pytest
from hypothesis import settings

from tests.support import bullet, slow

# Before numpy is loaded: two BLAS threads that share a busy core wait for one another, ten times as long as one takes.
for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(name, "1")

os.environ.setdefault("MPLBACKEND", "agg")
if "PYTEST_XDIST_WORKER" not in os.environ:  # workers share the cache of the process that starts them
    os.environ["GRASPFX_CACHE"] = mkdtemp(prefix="graspfx-tests-")
    atexit.register(rmtree, os.environ["GRASPFX_CACHE"], ignore_errors=True)

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell without a terminal starts what it does not wait for
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("graspfx", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("graspfx")


@pytest.fixture(autouse=True)
def programs(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile the loop as for users; where a test is marked `quick` in a tenth of the time, to the same bits."""
    if request.node.get_closest_marker("quick"):
        from graspfx.loop.tick import engine, programs

        monkeypatch.setitem(engine.ENGINES, "compiled", partial(programs.Compiled, quick=True))


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases that `make fast` leaves out, and those that no package here can run."""
    slow.mark(items)
    bullet.skip(items)
