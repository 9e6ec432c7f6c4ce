"""Fingertips that hang by springs on a free body, in MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np

from graspfx.bench.peers.paper import FloatArray, Springs, rotation_matrix
from graspfx.bench.peers.rigid import UNUSED

AXES = ("1 0 0", "0 1 0", "0 0 1")


class MuJoCoSprings:
    """Every coupling spring is a tendon of length zero between two sites: equal gains, kep = kip.

    Args:
        given: what it is made from; its internal gain is not looked at.
        steps: that one tick makes.
    """

    def __init__(self, scene: Springs, *, steps: int = 1) -> None:
        self._mujoco: Any = import_module("mujoco")
        self._springs, self._steps = scene, steps
        d = scene.dimensions
        sites = "".join(f'<site name="a{i}" pos="{_text(anchor)}"/>' for i, anchor in enumerate(scene.anchors))
        kind = {1: "", 2: 'type="hinge" axis="0 0 1"', 3: 'type="ball"'}[d]
        turn = f'<joint {kind} damping="{scene.rotational_viscosity!r}"/>' if kind else ""
        moments = " ".join([repr(scene.inertia)] * 3)
        fingers = "".join(
            f'<body pos="{_text(at)}">{_slides(d, scene.finger_friction, scene.hand, rest - at)}'
            f'<inertial pos="0 0 0" mass="{scene.finger_mass!r}" diaginertia="1 1 1"/><site name="f{i}"/></body>'
            for i, (at, rest) in enumerate(zip(scene.start, scene.rest, strict=True))
        )
        springs = "".join(
            f'<spatial stiffness="{scene.external!r}" springlength="0 0">'
            f'<site site="a{i}"/><site site="f{i}"/></spatial>'
            for i in range(len(scene.anchors))
        )
        self._model = self._mujoco.MjModel.from_xml_string(f"""
            <mujoco><option timestep="{scene.T!r}" gravity="0 0 0">{UNUSED}</option><worldbody>
              <body>{_slides(d, scene.viscosity, 0.0, np.zeros(d))}{turn}
                <inertial pos="0 0 0" mass="{scene.mass!r}" diaginertia="{moments}"/>{sites}</body>{fingers}
              </worldbody><tendon>{springs}</tendon></mujoco>""")
        self._data = self._mujoco.MjData(self._model)

    def reset(self) -> None:
        self._mujoco.mj_resetData(self._model, self._data)

    def tick(self) -> None:
        self._mujoco.mj_step(self._model, self._data, self._steps)

    def rollout(self, ticks: int) -> FloatArray:
        """Run from the start in one call that keeps every state, (ticks, 1 + positions + velocities)."""
        rollout: Any = import_module("mujoco.rollout")
        kind = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        first = np.empty(self._mujoco.mj_stateSize(self._model, kind))
        self.reset()
        self._mujoco.mj_getState(self._model, self._data, first, kind)
        states, _ = rollout.rollout(self._model, self._data, first, nstep=ticks, skip_checks=False)
        return np.asarray(states[0])

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Read position (d,) and rotation (d, d) of the object in a state of `rollout`."""
        q = state[1 : 1 + self._model.nq]
        return q[: self._springs.dimensions].copy(), self._rotation_of(q)

    @property
    def position(self) -> FloatArray:
        return np.array(self._data.qpos[: self._springs.dimensions])

    def rotation(self) -> FloatArray:
        return self._rotation_of(self._data.qpos)

    def _rotation_of(self, q: FloatArray) -> FloatArray:
        d = self._springs.dimensions
        if d < 3:
            return rotation_matrix(d, float(q[d]) if d == 2 else 0.0, ())
        w, x, y, z = q[3:7].tolist()
        return rotation_matrix(3, 0.0, (x, y, z, w))


def _slides(d: int, damping: float, stiffness: float, rest: FloatArray) -> str:
    return "".join(
        f'<joint type="slide" axis="{axis}" damping="{damping!r}" stiffness="{stiffness!r}" springref="{float(x)!r}"/>'
        for axis, x in zip(AXES[:d], rest, strict=True)
    )


def _text(point: Sequence[float] | FloatArray) -> str:
    """Write three numbers, those that a line or a plane does not have zero."""
    return " ".join(repr(float(x)) for x in [*point, 0.0, 0.0][:3])
