"""Jitter: how the time of a tick spreads, scene by scene, for each engine that runs it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial

import numpy as np

from graspfx import plugins
from graspfx.bench.case import Case, Method, is_installed
from graspfx.build.build import build
from graspfx.build.run import run
from graspfx.errors import DeviceError
from graspfx.loop.recording.header import Header
from graspfx.loop.recording.recorder import Recorder
from graspfx.loop.servo import Servo
from graspfx.objects.dynamics_table import dynamics_of
from graspfx.scene.load import load
from graspfx.scene.model import Scene

TITLE = "Jitter of the tick"
LIMITS = """
Ticks follow one another without waiting for the clock, in a process of ordinary priority, on a machine that does other
things too (see its load): the last quantiles are the scheduler's more than ours. Garbage collection is off, as it would
be in a loop that keeps time. A tick is the servo's sample with its recording, on simulated devices; a real one waits
for its bus.
"""

QUICK = ("reference-1dof", "paper-waving", "sphere-three-fingers")
CHECKED = 100  # ticks that are compared before any is timed
Ticker = Callable[[Scene], AbstractContextManager[Servo]]
ENGINES: dict[str, Ticker] = {engine: partial(build, engine=engine) for engine in ("compiled", "interpreted")}


def cases(quick: bool) -> Iterator[Case]:
    for name in QUICK if quick else plugins.names("scenes"):
        scene = load(name)
        if any(dynamics_of(thing.dynamics).missing for thing in scene.object):
            continue
        with ExitStack() as stack:
            engines = [engine for engine in ENGINES if engine != "compiled" or is_installed("llvmlite")]
            methods = [_method(stack, scene, engine) for engine in engines]
            yield Case("jitter", name, "m", methods, bound=1e-9)


def _method(stack: ExitStack, scene: Scene, engine: str) -> Method:
    step = stack.enter_context(_ticking(scene, engine))
    return Method(engine, step, lambda: _difference(scene, engine), singly=True)


@contextmanager
def _ticking(scene: Scene, engine: str) -> Iterator[Callable[[], None]]:
    """Run one tick with its recording; raise DeviceError once the scene has faulted: later ticks are none of it."""
    with ENGINES[engine](scene) as servo, _recorder(scene, servo) as recorder:

        def step() -> None:
            servo.tick(recorder)
            recorder.drain()
            if servo.faulted:
                raise DeviceError(f"{scene.title}: {recorder.faults[0]}")

        yield step


def _difference(scene: Scene, engine: str) -> float:
    """Find the largest difference of the fingers' positions from those of `run` [m]."""
    with ENGINES[engine](scene) as servo, _recorder(scene, servo) as recorder:
        for _ in range(CHECKED):
            servo.tick(recorder)
            recorder.drain()
        exact = run(scene, duration=CHECKED * scene.period).finger_position[-1]
        return float(np.abs(servo.row[servo.layout.columns["finger_position"].where] - exact.ravel()).max())


def _recorder(scene: Scene, servo: Servo) -> Recorder:
    return Recorder(servo.layout, Header(scene.period), keep=False)
