"""Choices that a scene leaves to its user, and runs of them: how long their ticks took, and where everything was."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.build.open_session import open as open_session
from graspfx.errors import GraspFXError
from graspfx.loop.recording.growth import growths
from graspfx.loop.recording.record import Recording
from graspfx.objects.dynamics_table import DYNAMICS, dynamics_of
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

INTEGRATORS = ("exact", "implicit", "semi-implicit", "explicit")
CARRIERS = {each.label: each.name for each in DYNAMICS.values() if each.integrator}  # PyBullet and MuJoCo
BODIES = (*INTEGRATORS, *CARRIERS)
COARSE, FINE = (2.0, 4.0), (0.5, 0.25)  # periods beside the scene's own, as multiples of it
FEW = 200  # ticks of an interpreted run: they are alike


@dataclass(frozen=True)
class Choice:
    """One choice: who moves the objects, how often, and what runs the ticks.

    Attributes:
        body: an integrator of the framework's own bodies, "PyBullet" or "MuJoCo".
        period: T [s].
        engine: "compiled" or "interpreted".
    """

    body: str
    period: float
    engine: str = "compiled"

    @property
    def name(self) -> str:
        """The choice as tables name it."""
        return f"{self.body}, {self.engine}" if self.engine != "compiled" else self.body

    @property
    def overrides(self) -> dict[str, Any]:
        """Values by dotted key that make a scene this choice."""
        values: dict[str, Any] = {"period": self.period, "engine": self.engine}
        if self.body in CARRIERS:
            return values | {"object.*.dynamics": CARRIERS[self.body]}
        return values | {"object.*.dynamics": "native", "object.*.integrator": self.body}


@dataclass(frozen=True)
class Trial:
    """A run of a choice.

    Attributes:
        places: of all objects and fingers at the instants that all choices have, (instants, things, d) [m].
        seconds: that a tick took on average [s], recorded in memory, nothing of it compiled any more.
        trouble: why it is no run to go by, such as a loss of stability; empty for a sound one.
    """

    places: FloatArray
    seconds: float
    trouble: str


def periods(scene: Scene, quick: bool) -> list[float]:
    """List the periods that are tried, the longest first."""
    shares = (*reversed(COARSE[: 1 if quick else 2]), 1.0, *FINE[: 1 if quick else 2])
    return [share * scene.period for share in shares]


def choices(scene: Scene, quick: bool) -> Iterator[Choice]:
    """List the choices of a scene, whether it takes them or not; interpreted, the scene's own alone."""
    for body in BODIES:
        for period in periods(scene, quick):
            yield Choice(body, period)
    yield Choice(own_body(scene), scene.period, "interpreted")


def own_body(scene: Scene) -> str:
    """Name who moves the objects of the scene as it stands: its first object counts."""
    first = scene.object[0]
    label = dynamics_of(first.dynamics).label
    return label if label in CARRIERS else first.integrator


def attempt(scene: Scene, choice: Choice, duration: float, instant: float, rounds: int = 1) -> Trial:
    """Run a scene by a choice.

    Args:
        scene: the scene.
        choice: what is chosen.
        duration: a whole number of instants [s].
        instant: from one instant that is looked at to the next, a whole number of periods [s].
        rounds: runs, of which the quickest counts.

    Raises:
        GraspFXError: the scene does not take the choice.
    """
    variant = scene.replace(choice.overrides)
    ticks, step = round(duration / choice.period), round(instant / choice.period)
    ticks = min(ticks, FEW) if choice.engine == "interpreted" else ticks
    least = math.inf
    for _ in range(rounds):
        recording, seconds = _run(variant, ticks)
        least = min(least, seconds)
    return Trial(_places(recording)[::step], least, _trouble(recording))


def refusal(error: GraspFXError) -> str:
    """Say on one line why a scene does not take a choice."""
    return " ".join(str(error).split())


def _run(scene: Scene, ticks: int) -> tuple[Recording, float]:
    with open_session(scene) as session:
        session.step(1)  # compiles
        began = perf_counter()
        session.step(ticks - 1)
        seconds = (perf_counter() - began) / (ticks - 1)
        return session.recording, seconds


def _places(recording: Recording) -> FloatArray:
    objects = [motion.position for motion in recording.objects.values()]
    return np.concatenate([np.stack(objects, axis=1), recording.finger_position], axis=1)


def _trouble(recording: Recording) -> str:
    if recording.faults:
        return recording.faults[0].message
    if not np.isfinite(_places(recording)).all():
        return "positions are not finite"
    grown = growths(recording)
    return f"{grown[0].mode} motion of {grown[0].object} is not stable" if grown else ""
