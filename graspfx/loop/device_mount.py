"""Relation of a device to its scene: its frame, its deadman switch and its call interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from graspfx.loop.device import Features
from graspfx.loop.device_frame import Frame


@dataclass(frozen=True, eq=False)
class Fitting:
    """Relation of a device to its scene.

    Attributes:
        frame: Frame of the device in the scene; None for the scene's axes.
        deadman: Index of the switch that must be held to allow forces; None if there is none.
        every: Number of ticks from one exchange with the device to the next.
        measures: Features measured on this device, which replace those that the driver reports.
        jitter: Smallest and largest lateness, each ignoring 1 % of the samples [s]; None if unknown.
        round_trip: Part of the lateness due to reading and writing [s].
    """

    frame: Frame | None = None
    deadman: int | None = None
    every: int = 1
    measures: Mapping[str, Any] = field(default_factory=dict)
    jitter: tuple[float, float] | None = None
    round_trip: float = 0.0

    @property
    def scale(self) -> float:
        """Metres in the scene per metre of the device."""
        return 1.0 if self.frame is None else self.frame.scale

    def features(self, own: Features) -> Features:
        """Convert a device's features to the scene. An exchange every m ticks adds m - 1 samples to the delay."""
        if self.measures:
            own = replace(own, **self.measures)
        if self.every > 1:
            own = replace(own, delay=(own.delay or 0) + self.every - 1)
        return own if self.frame is None else self.frame.features(own)


PLAIN = Fitting()
