"""Setting of every test: figures without a display, a cache that is not the user's, the same examples every time."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from tests.support import bullet, slow
from tests.support.optional import require

if TYPE_CHECKING:
    from tests.support.chromium import Browser

# Before numpy is loaded: two BLAS threads that share a busy core wait for one another, ten times as long as one takes.
for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(name, "1")

os.environ.setdefault("MPLBACKEND", "agg")
if "PYTEST_XDIST_WORKER" not in os.environ:  # workers share the cache of the process that starts them
    kept = os.environ.get("GRASPFX_TESTS_CACHE")
    if kept is None and sys.prefix != sys.base_prefix:  # in this environment, and in no system's
        kept = str(Path(sys.prefix) / "graspfx-tests-cache")
    if kept is None:
        kept = mkdtemp(prefix="graspfx-tests-")
        atexit.register(rmtree, kept, ignore_errors=True)
    os.environ["GRASPFX_CACHE"] = kept

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell without a terminal starts what it does not wait for
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("graspfx", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("graspfx")


@pytest.fixture(autouse=True)
def programs(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile programs of scenes in a tenth of the time, to the same bits; as for users if a test is `optimised`."""
    if not request.node.get_closest_marker("optimised"):
        from graspfx.loop.tick import engine, programs

        quick = partial(programs.Compiled, quick=True)
        monkeypatch.setitem(engine.ENGINES, "compiled", quick)
        monkeypatch.setattr(engine, "Compiled", quick)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """Start the browser once, for all tests of pages."""
    from tests.support.chromium import chromium

    with chromium() as browser:
        yield browser


@pytest.fixture
def browser(chromium: Browser) -> Iterator[Browser]:
    """Lend the browser to a test, and close the pages that it leaves open."""
    before = set(chromium.pages)
    yield chromium
    for page in set(chromium.pages) - before:
        page.close()


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases that `make fast` leaves out, and those that no package here can run."""
    slow.mark(items)
    bullet.skip(items)


@pytest.fixture
def new_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache as after `graspfx warmup --kernels`: the library of kernels is there, and nothing of a scene."""
    from graspfx.compile import cache, freshness, generic
    from graspfx.loop.tick.library import LIBRARY

    generic.library(LIBRARY)
    request = generic._library_key(LIBRARY)
    machine = generic._machine_key(require(freshness.recall(request)))
    kept = {name: require(cache.load(name)) for name in (request, machine)}
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    for name, content in kept.items():
        cache.store(name, content)
    return tmp_path / "cache"
