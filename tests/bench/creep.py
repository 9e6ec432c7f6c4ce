"""A pinched box that should hang still: how fast it creeps in MuJoCo, with each of its settings for it, and here."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed
from tests.bench.peers import imported

TITLE = "A pinched box that hangs still: creep"
LIMITS = """
Two fingers of 0.1 kg squeeze a box of 45 g and 40 mm with 1.5 N, at a coefficient of friction of 0.7. Friction can
carry nearly five times the weight, so that nothing should move. The error is the box's mean downward speed from 2 s
to 4 s. MuJoCo regularises friction: contacts creep in proportion to their load, ten times less with `impratio` 10,
and not at all after ten iterations of its projected Gauss-Seidel pass (`noslip`), which it offers for this purpose
(its issue 3328 reports 150 um/s with `impratio` 10, 1502 with the elliptic and 2263 with the pyramidal cone, and 0.22
with `noslip`). The fingertips in MuJoCo are boxes, which hold better than its balls. Times are per step of 2 ms: for
GraspFX a whole tick with devices, hands and a recorded row, for MuJoCo a bare step.
"""

PERIOD, SECONDS = 0.002, 4.0  # [s]
MASS, FINGER, FRICTION, SQUEEZE, HALF = 0.045, 0.1, 0.7, 1.5, 0.02  # [kg], [kg], -, [N], [m]
STIFFNESS, HAND = 1000.0, 300.0  # of the coupling, of the hands' springs [N/m]
STEPS = round(SECONDS / PERIOD)
SETTINGS: dict[str, dict[str, Any]] = {
    "MuJoCo, elliptic, noslip": {"impratio": 10, "noslip_iterations": 10, "noslip_tolerance": 0},
    "MuJoCo, elliptic, impratio 10": {"impratio": 10},
    "MuJoCo, elliptic": {},
    "MuJoCo, pyramidal": {"cone": "pyramidal"},
}


def cases(quick: bool) -> Iterator[Case]:
    """Yield the one case."""
    methods = [Method("GraspFX, whole tick", ticks(), partial(creep, recording), calls=STEPS)]
    methods += [Method(name, *peer(settings), calls=STEPS) for name, settings in SETTINGS.items()]
    yield Case("creep", "box of 45 g, 1.5 N, 0.7", "m/s", methods)


def scene() -> gx.Scene:
    """The pinch at rest, but for the weight: springs of coupling and hands in series bear the squeeze."""
    depth = SQUEEZE / STIFFNESS
    return gx.Scene(
        dimensions=3, period=PERIOD, duration=SECONDS, gravity=[0.0, 0.0, -9.81],
        engine="compiled" if is_installed("llvmlite") else "interpreted",
        object={"mass": MASS, "viscosity": 0.1, "rotational_viscosity": 1e-4,
                "shape": {"kind": "box", "size": [2.0 * HALF] * 3}},
        coupling={"external": {"stiffness": STIFFNESS, "damping": 1.0},
                  "internal": {"stiffness": STIFFNESS, "damping": 1.0}, "friction": FRICTION},
        finger=[
            {"device": {"name": "simulated", "mass": FINGER, "damping": 2.0},
             "start": [side * (HALF - depth), 0.0, 0.0],
             "hand": {"stiffness": HAND, "damping": 5.0, "rest": [side * (HALF - depth - SQUEEZE / HAND), 0.0, 0.0]}}
            for side in (-1.0, 1.0)
        ],
    )  # fmt: skip


def recording() -> tuple[float, float]:
    """Run the scene; give the box's height in the middle and at the end [m]."""
    height = gx.run(scene()).object_position[:, 2]
    return float(height[STEPS // 2 - 1]), float(height[-1])


def creep(heights: Any) -> float:
    """Compute the speed downwards in the second half [m/s]."""
    middle, end = heights()
    return abs(end - middle) / (0.5 * SECONDS)


def ticks() -> Any:
    """Make the call of our ticks."""
    return partial(gx.open(scene()).step, STEPS)


def peer(settings: dict[str, Any]) -> tuple[Any, Any]:
    """Make the call of MuJoCo's steps, and its error; without the package both say what to install."""

    def made() -> tuple[Any, Any, Any]:
        mujoco = imported("mujoco", "the peer of MuJoCo")
        options = {"cone": "elliptic", "iterations": 100, "tolerance": 1e-12, **settings}
        words = " ".join(f'{name}="{value}"' for name, value in options.items())
        model = mujoco.MjModel.from_xml_string(f"""
            <mujoco><option timestep="{PERIOD}" {words}/>
            <default><geom type="box" size="0.01 0.01 0.01" friction="{FRICTION} 0 0" mass="{FINGER}"/></default>
            <worldbody>
            <body><freejoint/><geom size="{HALF} {HALF} {HALF}" mass="{MASS}"/></body>
            <body pos="{-HALF - 0.01} 0 0"><joint name="left" type="slide" axis="1 0 0"/><geom/></body>
            <body pos="{HALF + 0.01} 0 0"><joint name="right" type="slide" axis="-1 0 0"/><geom/></body>
            </worldbody>
            <actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>""")
        data = mujoco.MjData(model)
        data.ctrl[:] = SQUEEZE
        return mujoco, model, data

    def heights() -> tuple[float, float]:
        mujoco, model, data = made()
        mujoco.mj_step(model, data, STEPS // 2)
        middle = float(data.qpos[2])
        mujoco.mj_step(model, data, STEPS // 2)
        return middle, float(data.qpos[2])

    ready: list[Any] = []

    def steps() -> None:
        if not ready:
            ready.extend(made())
        mujoco, model, data = ready
        mujoco.mj_step(model, data, STEPS)

    return steps, partial(creep, heights)
