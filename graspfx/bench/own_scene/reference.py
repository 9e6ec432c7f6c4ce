"""The motion to which choices are compared: the scene's at ever smaller periods, until it changes no more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.own_scene.own_choices import CARRIERS, Choice, attempt, own_body
from graspfx.progress import waiting
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

SMALL = 1e-4  # error over the extent of the motion with which a reference is good enough
MOST_TICKS = 400_000
MOST_HALVINGS = 10
ALIKE = 0.3  # orders of two halvings that agree
LEAST_ORDER = 0.7


@dataclass(frozen=True)
class Reference:
    """The motion at the smallest period.

    Attributes:
        body: the integrator.
        period: the smallest one [s].
        places: (instants, things, d) [m].
        error: the estimate of its own error [m].
        order: q with which changes shrink as the period does; None where two halvings do not agree on one.
        changes: the largest change by each halving [m].
    """

    body: str
    period: float
    places: FloatArray
    error: float
    order: float | None
    changes: tuple[float, ...]

    @property
    def extent(self) -> float:
        """The farthest that anything moves along an axis [m]."""
        return float(np.ptp(self.places, axis=0).max())

    def distance(self, places: FloatArray) -> float:
        """Compute the largest distance of anything from where it is here [m]."""
        return distance(places, self.places)

    def text(self) -> str:
        """Say how the reference was computed, and how its error was estimated."""
        halved = f"{self.body}, period halved {len(self.changes)} times to {self.period:.3g} s"
        if self.order is None:
            how = "the last change, as changes follow no one order"
        else:
            how = f"Richardson: the last change, {self.changes[-1]:.1e} m, over 2^{self.order:.2f} - 1"
        return f"{halved}; its own error is about {self.error:.1e} m ({how})"


def distance(places: FloatArray, others: FloatArray) -> float:
    """Compute the largest distance between the places of one motion and of another, (instants, things, d) each."""
    return float(np.linalg.norm(places - others, axis=2).max())


def estimate(changes: Sequence[float]) -> tuple[float, float | None]:
    """Estimate the error that is left after halvings that changed a motion so much, and the order they show.

    With x_h = x + C h^q the last change is d = C h^q (2^q - 1), and C h^q = d / (2^q - 1) is left. Where the last two
    ratios of changes show no common order, or too low a one, the last change itself stands for the error.

    Args:
        changes: by each halving, the last one last.
    """
    last = changes[-1]
    if last == 0.0:
        return 0.0, None
    orders = [math.log2(a / b) if a > 0.0 and b > 0.0 else -math.inf for a, b in pairwise(changes)]
    if len(orders) < 2 or abs(orders[-1] - orders[-2]) > ALIKE or orders[-1] < LEAST_ORDER:
        return last, None
    return last / (2.0 ** orders[-1] - 1.0), orders[-1]


def converge(scene: Scene, duration: float, instant: float, *, small: float = SMALL) -> Reference:
    """Halve a scene's period until its motion changes no more than by a share of its extent.

    The framework's own bodies move by the exact integrator, or as the scene has it where others move them and they
    cannot.

    Args:
        scene: the scene.
        duration: a whole number of instants [s].
        instant: from one instant that is looked at to the next [s].
        small: error over the extent of the motion.

    Raises:
        GraspFXError: the scene does not take a smaller period.
    """
    body = own_body(scene)
    body = body if body in CARRIERS else "exact"
    period, changes = scene.period, list[float]()
    with waiting("finding a reference", MOST_HALVINGS, "") as wait:
        trial = attempt(scene, Choice(body, period), duration, instant)
        while True:
            if duration / (0.5 * period) > MOST_TICKS or len(changes) == MOST_HALVINGS:
                break
            finer = attempt(scene, Choice(body, 0.5 * period), duration, instant)
            changes.append(distance(finer.places, trial.places))
            period, trial, wait.done = 0.5 * period, finer, wait.done + 1
            error, _ = estimate(changes)
            if len(changes) >= 3 and error <= small * float(np.ptp(trial.places, axis=0).max()):
                break
    error, order = estimate(changes) if changes else (math.inf, None)
    return Reference(body, period, trial.places, error, order, tuple(changes))
