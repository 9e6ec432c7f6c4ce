"""What every test stands on: figures without a display, no cache of the user's, the same examples every time."""

from __future__ import annotations

import atexit
import os
from shutil import rmtree
from tempfile import mkdtemp

from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "agg")
os.environ["GRASPFX_CACHE"] = mkdtemp(prefix="graspfx-tests-")
atexit.register(rmtree, os.environ["GRASPFX_CACHE"], ignore_errors=True)

settings.register_profile("graspfx", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("graspfx")
