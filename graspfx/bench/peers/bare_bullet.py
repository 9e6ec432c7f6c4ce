"""The calls to PyBullet that a tick cannot do without: push, step, read."""

from __future__ import annotations

import weakref

import numpy as np

from graspfx.bench.peers.paper import FloatArray, Springs, rotation_matrix
from graspfx.bench.peers.rigid import free_body
from graspfx.objects.bullet.bullet import new_client, pybullet
from graspfx.objects.decay import decay_integrals

Three = tuple[float, float, float]


class BareBullet:
    """A body that is given known wrenches, sample by sample.

    Args:
        given: mass, inertia, viscosities and period.
        wrench: (N, w) of a run on PyBullet; velocity (N, d) and spin (N, ...) of that run, for the exact viscosity.
    """

    def __init__(self, scene: Springs, wrench: FloatArray, velocity: FloatArray, spin: FloatArray | None) -> None:
        d, T = scene.dimensions, scene.T
        self._dimensions = d
        self._bullet = bullet = pybullet()
        self._client = client = new_client()
        weakref.finalize(self, bullet.disconnect, client)
        self._body = free_body(bullet, client, scene.mass, [scene.inertia] * 3, T)
        count = len(wrench)
        pushes, twists = np.zeros((count, 3)), np.zeros((count, 3))
        share = decay_integrals(scene.viscosity * T / scene.mass)[1]
        pushes[:, :d] = share * (wrench[:, :d] - scene.viscosity * velocity)
        if spin is not None:
            b = scene.rotational_viscosity
            share = decay_integrals(b * T / scene.inertia)[1]
            twists[:, 2 if d == 2 else 0 :] = share * (wrench[:, d:] - b * spin.reshape(count, -1))
        self._pushes: list[Three] = [(x, y, z) for x, y, z in pushes.tolist()]
        self._twists: list[Three] = [(x, y, z) for x, y, z in twists.tolist()]
        self.reset()

    def reset(self) -> None:
        bullet, client, body = self._bullet, self._client, self._body
        bullet.resetBasePositionAndOrientation(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
        bullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), physicsClientId=client)
        self._where, self._turn = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)

    def run(self) -> None:
        """Run all samples."""
        bullet, client, body = self._bullet, self._client, self._body
        force, torque, step = bullet.applyExternalForce, bullet.applyExternalTorque, bullet.stepSimulation
        place, motion, frame = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity, bullet.WORLD_FRAME
        turns = self._dimensions > 1
        where, turn = self._where, self._turn
        for push, twist in zip(self._pushes, self._twists, strict=True):  # by position, the fastest way to call them
            force(body, -1, push, where, frame, client)
            if turns:
                torque(body, -1, twist, frame, client)
            step(client)
            where, turn = place(body, client)
            motion(body, client)
        self._where, self._turn = where, turn

    @property
    def position(self) -> FloatArray:
        return np.array(self._where[: self._dimensions])

    def rotation(self) -> FloatArray:
        d = self._dimensions
        return rotation_matrix(3, 0.0, self._turn)[:d, :d]
