"""The fitting of a device to its scene: its frame, its deadman, and how often it is called."""

from __future__ import annotations

from dataclasses import dataclass, replace

from graspfx.loop.device import Features
from graspfx.loop.device_frame import Frame


@dataclass(frozen=True, eq=False)
class Fitting:
    """How a device is fitted to its scene.

    Attributes:
        frame: in which it stands; None for the scene's own axes.
        deadman: number of the switch without which there is no force; None for none.
        every: ticks from one reading and writing of it to the next.
    """

    frame: Frame | None = None
    deadman: int | None = None
    every: int = 1

    @property
    def scale(self) -> float:
        """Metres of the scene for a metre of the device."""
        return 1.0 if self.frame is None else self.frame.scale

    def features(self, own: Features) -> Features:
        """Give what a device's features are in the scene; one called every m ticks is m - 1 samples later."""
        if self.every > 1:
            own = replace(own, delay=(own.delay or 0) + self.every - 1)
        return own if self.frame is None else self.frame.features(own)


PLAIN = Fitting()
