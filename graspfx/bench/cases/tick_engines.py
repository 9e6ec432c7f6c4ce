"""Ways in which ours runs a scene, for benchmarks of ticks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from graspfx.build.build import build
from graspfx.build.run import run
from graspfx.loop.recording.header import Header
from graspfx.loop.recording.record import Recording
from graspfx.loop.recording.recorder import Recorder
from graspfx.scene.model import Scene


@dataclass(frozen=True)
class Engine:
    """One way that ours runs a scene.

    Attributes:
        name: of the method.
        engine: as a scene names it.
        packages: that it needs.
    """

    name: str
    engine: str
    packages: Sequence[str] = ()

    def start(self, scene: Scene) -> Callable[[int], object]:
        """Start a run of the scene whose rows are recorded and dropped; each call does so many ticks."""
        with ExitStack() as stack:
            servo = stack.enter_context(build(self.of(scene)))
            recorder = stack.enter_context(Recorder(servo.layout, Header(scene.period), keep=False))
            owner = stack.pop_all()

        def ticks(count: int, _: object = owner) -> None:
            servo.run(count, recorder)

        return ticks

    def record(self, scene: Scene, seconds: float) -> Recording:
        """Record a whole run of the scene."""
        return run(self.of(scene), duration=seconds)

    def of(self, scene: Scene) -> Scene:
        return scene.model_copy(update={"engine": self.engine})


ENGINES: Sequence[Engine] = (
    Engine("GraspFX, compiled", "compiled", ("llvmlite",)),
    Engine("GraspFX, interpreted", "interpreted"),
)
ON_BULLET: Sequence[Engine] = (
    Engine("GraspFX on PyBullet", "compiled", ("pybullet", "llvmlite")),
    Engine("GraspFX on PyBullet, interpreted", "interpreted", ("pybullet",)),
)
