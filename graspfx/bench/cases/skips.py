"""Time that a tick saves by each step that its scene does not need: two programs that differ in that one thing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.build.build import build
from graspfx.compile.records import Many
from graspfx.coupling import block as at
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.tick.memory import CHUNK
from graspfx.loop.tick.programs import Compiled
from graspfx.scene.model import Scene
from graspfx.surfaces.triangles.mesh_finger import MeshFinger

TITLE = "Steps that a scene does not need"
LIMITS = """
Each case is a grasp of a ball in space by fingers with hands of their own, compiled, many ticks a call, and the same
with one thing less; the ratio is to the shortest tick. Ticks are not recorded but where recording is what is skipped.
Where both have to move alike the error is the largest difference of a fingertip's position after a second; where they
do not (another dimension, another coefficient) there is none. The split that is made anew in every tick and the gains
that differ by a part in 10^12 are asked for here alone. What a skip saves depends on the number of fingers.
"""

FloatArray = NDArray[np.float64]
TICKS = 1000
PERIOD = 0.001  # [s]
RADIUS, FAR = 0.03, 0.2  # of the ball, and of a finger that is far from it [m]
EXTERNAL, INTERNAL = 200.0, 400.0  # [N/m]


@dataclass
class Program:
    """A scene's ticks as one program, its state as it goes on.

    Args:
        name: of the method.
        scene: that is run.
        recorded: whether ticks are.
        before: lines of the script before each tick, given the name of the object's block.
        prepare: what is done to the block at first.
    """

    name: str
    scene: Scene
    recorded: bool = False
    before: Callable[[str], Sequence[str]] = lambda name: ()
    prepare: Callable[[FloatArray], None] = lambda block: None
    _stack: ExitStack = field(default_factory=ExitStack)

    @cached_property
    def run(self) -> Callable[[], None]:
        """So many ticks more."""
        servo = self._stack.enter_context(build(self.scene, engine="interpreted", record=self.recorded))
        tick = servo.script
        block = servo.objects[0].grasped.block
        name = next(name for name, array in tick.script.arrays.items() if array is block)
        self.prepare(block)
        tick.begin[:0] = self.before(name)
        engine = Compiled(tick)
        engine.write_to(np.empty((CHUNK if self.recorded else 0, servo.layout.width)))
        self._rows = servo.objects[0].grasped.finger_position
        ticks = 0

        def run() -> None:
            nonlocal ticks
            ticks += engine.run(ticks, TICKS, 0)

        return run

    @property
    def finger_position(self) -> FloatArray:
        """(n, 3) [m] at the last tick."""
        return self._rows

    def again(self) -> Program:
        """Reset the program to its start."""
        return Program(self.name, self.scene, self.recorded, self.before, self.prepare)


def cases(quick: bool) -> Iterator[Case]:
    """Yield a case for each step."""
    for name, programs, alike in skips():
        if not is_installed("llvmlite"):
            yield Case("skips", name, "", [missing(each.name, "llvmlite") for each in programs])
            continue
        methods = [_method(each, programs[0], alike) for each in programs]
        yield Case("skips", name, "m" if alike else "", methods, bound=1e-9 if alike else None)


def _method(program: Program, first: Program, alike: bool) -> Method:
    def error() -> float:
        if not alike:
            return 0.0
        one, other = program.again(), first.again()
        one.run()
        other.run()
        return float(np.abs(one.finger_position - other.finger_position).max())

    return Method(program.name, lambda: program.run(), error, calls=TICKS)


def skips() -> Iterator[tuple[str, list[Program], bool]]:
    """Yield the cases' names, their programs from the whole to the least, and whether these move alike."""
    for contact in ("attached", "unilateral"):
        equal = ball({"coupling.contact": contact, "coupling.internal.stiffness": EXTERNAL})
        nearly = equal.replace({"coupling.internal.stiffness": EXTERNAL * (1.0 + 1e-12)})
        yield f"equal gains, {contact}", [Program("split", nearly), Program("no split", equal)], True
    attached = ball({"coupling.contact": "attached"})
    anew = Program("split in every tick", attached, before=lambda name: [f"{name}[{at.SPLIT_KNOWN}] = 0.0"])
    yield "fixed contacts", [anew, Program("split once", attached)], True
    yield "fingers", [Program(f"{n} fingers" if n > 1 else "1 finger", ball(n=n)) for n in (5, 3, 2, 1)], False
    yield "dimensions", [Program({3: "space", 2: "plane", 1: "line"}[d], ball(n=2, d=d)) for d in (3, 2, 1)], False
    rubbing = {name: ball({"coupling.friction": mu}) for name, mu in (("friction", 0.5), ("sticking", "stick"))}
    yield (
        "friction",
        [*(Program(name, scene) for name, scene in rubbing.items()), Program("none", ball())],
        False,
    )
    waving = {"finger.0.hand.motion": {"kind": "sine", "amplitude": 0.004, "axis": [0.0, 0.0, 1.0], "frequency": 2.0}}
    slippery, rough = (ball({**waving, "coupling.friction": mu}) for mu in (0.02, 2.0))
    yield "forces in their cones", [Program("sliding", slippery), Program("inside", rough)], False
    moving = {
        "stiffness": 300.0,
        "motion": {"kind": "sine", "amplitude": 0.1, "axis": [0.0, 0.8, 0.6], "frequency": 2.0},
    }
    far = {"object.shape": facetted(), "finger.4.start": [FAR, FAR, 0.0], "finger.4.hand": moving}
    exact = Program("exact distance", ball(far), prepare=look_as_far_as_it_takes)
    yield "a finger far from a mesh", [exact, Program("safe distance", ball(far))], True
    damped = ball({"coupling.internal.damping": 0.2})
    yield "virtual damping", [Program("damping", damped), Program("none", ball())], False
    yield "recording", [Program("recorded", ball(), recorded=True), Program("not recorded", ball())], True
    watched = [Program(each, ball({"coupling.passivity": each})) for each in ("control", "observe", "off")]
    yield "observers", watched, True
    tip, contact_point = (ball({"coupling.reaction": each}) for each in ("fingertip", "contact"))
    yield "reaction", [Program("at the fingertip", tip), Program("at the contact", contact_point)], False
    follows = ball({"coupling.absent": "follow"})
    yield "fade", [Program("fades", ball()), Program("follows", follows)], True


def ball(changes: Mapping[str, Any] = MappingProxyType({}), n: int = 5, d: int = 3) -> Scene:
    """Place fingers about a ball (a box on a line), pulled 3 mm into it; changes by dotted key."""
    turn = 2.0 * math.pi / n
    about = [(math.cos(turn * i), math.sin(turn * i), 0.0)[:d] for i in range(n)]
    shape: Mapping[str, Any] = (
        {"kind": "sphere", "radius": RADIUS} if d > 1 else {"kind": "box", "size": [2.0 * RADIUS]}
    )
    thing: dict[str, Any] = {"mass": 0.1, "viscosity": 0.8, "shape": shape}
    if d > 1:
        thing["rotational_viscosity"] = 3e-4
    return Scene(
        dimensions=d,
        period=PERIOD,
        duration=1.0,
        object=thing,
        coupling={"external": {"stiffness": EXTERNAL}, "internal": {"stiffness": INTERNAL}},
        finger=[
            {
                "device": {"name": "simulated", "mass": 0.15, "damping": 2.0},
                "hand": {"stiffness": 300.0, "rest": [(RADIUS - 0.003) * x for x in u]},
                "start": [(RADIUS - 1e-4) * x for x in u],
            }
            for u in about
        ],
    ).replace(changes)


def look_as_far_as_it_takes(block: FloatArray) -> None:
    """Make the gap of a finger on a mesh the exact one, however large."""
    grasp = GraspState(block)
    Many(MeshFinger, block, grasp.fingers[0].walk.offset, grasp.count).array(MeshFinger.reach)[:] = np.inf


def facetted() -> dict[str, Any]:
    """Approximate the ball by 5120 triangles."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    return {"vertices": mesh.vertices.tolist(), "faces": mesh.faces.tolist()}
