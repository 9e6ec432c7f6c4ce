"""A fake of hardware with switches and a wire, by the driver that a scene names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from graspfx.loop.device import Features
from tests.support.hardware import Fake

DRIVER = """
from tests.support.pedal import Pedal

def connect(**settings):
    return Pedal(**settings)
"""


class Pedal(Fake):
    """A fake with three switches, which shows counts that came over its wire."""

    def __init__(self, position: Any, evil: str = "", at: int = 10, workspace: Any = None) -> None:
        super().__init__(position, evil, at, workspace)
        k, d = self.x.shape
        self.features = Features(fingers=k, dimensions=d, peak_force=1.0, switches=3)
        self.raw = np.zeros(2, dtype=np.int64)

    switches: Any = property(lambda self: max(self.tick, 0) // 10 % 8)

    def read(self) -> Any:
        reading = super().read()
        self.raw[:] = self.reads, -(1 << 40) - self.reads
        return reading


def pedal(folder: Path) -> str:
    """Write the driver of the pedal; give its path."""
    file = folder / "pedals.py"
    file.write_text(DRIVER)
    return str(file)
