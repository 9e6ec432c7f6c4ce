"""What every test stands on: figures without a display, and hypothesis with the same examples every time."""

from __future__ import annotations

import os

from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "agg")

settings.register_profile("graspfx", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("graspfx")
