"""Setting of every test: figures without a display, a cache that is not the user's, the same examples every time."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from tests.support import bullet, slow

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
def new_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache as after `graspfx warmup`: the programs of all scenes and loops are there, and nothing else."""
    from graspfx.compile import cache
    from graspfx.loop import engine
    from graspfx.loop.realtime import beat
    from graspfx.loop.realtime.lifecycle import HAS_NATIVE

    kept: dict[str, bytes] = {}
    engine.program()
    if HAS_NATIVE:
        beat.program()

    def noted(name: str, load: Callable[[str], bytes | None] = cache.load) -> bytes | None:
        content = load(name)
        if content is not None:
            kept[name] = content
        return content

    with monkeypatch.context() as patch:
        patch.setattr(cache, "load", noted)
        engine.kept_program()
        beat.program.cache_clear()
        if HAS_NATIVE:
            beat.program()
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path / "cache"))
    for name, content in kept.items():
        cache.store(name, content)
    for each in (engine.program, beat.program):
        each.cache_clear()
    yield tmp_path / "cache"
    for each in (engine.program, beat.program):
        each.cache_clear()
