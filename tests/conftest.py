"""What every test stands on: figures without a display, hypothesis with the same examples, a cache of its own."""

from __future__ import annotations

import os
from functools import partial

import pytest
from hypothesis import settings

from graspfx.loop import engine

os.environ.setdefault("MPLBACKEND", "agg")

settings.register_profile("graspfx", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("graspfx")

FULLY_COMPILED = engine.Compiled
engine.Compiled = partial(engine.Compiled, quick=True)  # type: ignore[misc] # in a tenth of the time, to the same bits
engine.ENGINES["compiled"] = engine.Compiled


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Compiled code is neither taken from the user's folder nor left there."""
    os.environ["GRASPFX_CACHE"] = str(tmp_path_factory.mktemp("compiled"))
