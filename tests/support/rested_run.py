"""A run of simulated devices and one object to its rest, and what a tick does to small motions about there."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import resolve
from graspfx.compile.records import numbers, start_of
from graspfx.coupling.grasp_state import FingerState
from graspfx.loop.velocity import VelocityEstimate
from graspfx.objects import integrators as body
from graspfx.objects.body_state import BodyState
from graspfx.objects.floor.planes import FloorState
from graspfx.recording.recorder import Recorder
from graspfx.spatial import Quaternion, Vector, exponential

STEP = 1e-7  # [m], [m/s]


class TickDifferences(NamedTuple):
    """Derivatives by the state before a tick: of the state after it, the fingers' forces and the object's wrench."""

    after: np.ndarray
    force: np.ndarray
    wrench: np.ndarray


class RestedRun:
    """A run of simulated devices and one object, recorded to its end, that can go on with other gains.

    Args:
        scene: what is run.
        duration: until it rests [s].
    """

    def __init__(self, scene: gx.Scene, duration: float, engine: str = "interpreted") -> None:
        self.scene = scene
        self._stack = ExitStack()
        self.servo = self._stack.enter_context(build(scene, engine=engine))
        self.recording = self.run(round(duration / scene.period))
        self.grasped = self.servo.objects[0].grasped
        self.state = self.grasped.body_state
        self._arrays = self.servo.arena.arrays
        self._rest = [array.copy() for array in self._arrays]

    def close(self) -> None:
        self._stack.close()

    def run(self, ticks: int) -> gx.Recording:
        with Recorder(self.servo.layout, header_of(resolve(self.scene))) as recorder:
            self.servo.run(ticks, recorder)
            return recorder.finish()

    def restore(self) -> None:
        """Put everything back to rest."""
        for array, rest in zip(self._arrays, self._rest, strict=True):
            array[:] = rest

    def set_external(self, stiffness: float) -> None:
        self.grasped.state.external_stiffness = stiffness

    def growth(self, external: float, skip: int, ticks: int, speed: float) -> float:
        """Push the fingers a little, wait, and measure the growth of the force's swing per sample."""
        self.restore()
        self.set_external(external)
        rng = np.random.default_rng(1)
        for moved in self.servo.plants:
            plant: Any = moved.plant
            velocity = plant.state[plant.ports.velocity :][: plant.position.size]
            velocity += speed * rng.normal(size=velocity.shape)
        self.run(skip)
        force = self.run(ticks).finger_force.reshape(ticks, -1)
        swing = np.diff(force, 2, axis=0)
        k = np.arange(len(swing))
        # energy of the swing over windows of a quarter, first against last
        first, last = swing[: ticks // 4], swing[-(ticks // 4) :]
        return float((np.sqrt((last**2).sum()) / np.sqrt((first**2).sum())) ** (1.0 / (k[-1] - ticks // 4 + 1)))

    def spectral_radius(self, external: float) -> float:
        """The largest eigenvalue of a tick's derivative, but for 1: what nothing depends on stays as it is."""
        sizes = np.linalg.eigvals(self.tick_matrix(external))
        return float(np.abs(sizes[np.abs(sizes - 1.0) > 1e-5]).max())

    def tick_matrix(self, external: float) -> np.ndarray:
        """d(state after a tick)/d(state before it), contacts too rough to slide; central differences."""
        return self.tick_differences(external).after

    def tick_differences(self, external: float | None = None) -> TickDifferences:
        """Move each coordinate a little to both sides, and tick once."""
        self.restore()
        if external is not None:
            self.set_external(external)
        self.grasped.array(FingerState.coefficient)[:] *= 1e3
        rough = [array.copy() for array in self._arrays]
        columns = []
        for i in range(self._size()):
            ends = []
            for sign in (1.0, -1.0):
                for array, still in zip(self._arrays, rough, strict=True):
                    array[:] = still
                before = self._read()
                self._move(i, sign * STEP)
                tick = self.run(1)
                wrench = next(iter(tick.objects.values())).wrench[0]
                ends.append((self._read(before), tick.finger_force[0].ravel(), wrench))
            columns.append([(ahead - behind) / (2 * STEP) for ahead, behind in zip(*ends, strict=True)])
        self.restore()
        return TickDifferences(*(np.array(each).T for each in zip(*columns, strict=True)))

    # Coordinates: fingers' positions, velocities and last readings, the object's position, velocity and spin, what a
    # floor remembers, the object's turn.

    def _size(self) -> int:
        return len(self._parts()) + (1 if self.scene.dimensions == 2 else 3)

    def _parts(self) -> list[tuple[np.ndarray, int]]:
        """(array, entry) of every coordinate but the turn's."""
        d = self.scene.dimensions
        turns = [2] if d == 2 else [0, 1, 2]
        found: list[tuple[np.ndarray, int]] = []
        for which in ("position", "velocity"):
            for moved in self.servo.plants:
                plant: Any = moved.plant
                state, start = plant.state, getattr(plant.ports, which)
                found += [(state, start + k) for k in range(plant.position.size)]
        newest = start_of(VelocityEstimate, "positions")
        for station in self.servo.stations:
            device: Any = station.device
            found += [(device.state, estimate.offset + newest) for estimate in device._estimates]
        for first, axes in ((body.POSITION, range(d)), (body.VELOCITY, range(d)), (body.ANGULAR_VELOCITY, turns)):
            found += [(self.state, first + a) for a in axes]
        floor = getattr(self.servo.movers[0].body, "buffer", None)
        if floor is not None:
            block = FloorState(floor)
            memory, end = block.memory.offset, block.contacts.offset
            found += [(floor, k) for k in range(memory, end) if d == 3 or (k - memory) % 2 == 0]
            if self.grasped.implicit:
                force, moment = start_of(FloorState, "force"), start_of(FloorState, "moment")
                found += [(floor, force + a) for a in range(d)] + [(floor, moment + a) for a in turns]
        return found

    def _read(self, origin: np.ndarray | None = None) -> np.ndarray:
        d = self.scene.dimensions
        values = [array[entry] for array, entry in self._parts()]
        if d == 2:
            return np.array([*values, self.state[body.ANGLE]])
        q = self.state[body.QUATERNION : body.QUATERNION + 4]
        if origin is None:
            return np.array([*values, *q])
        turn = Quaternion(*q.tolist()) @ Quaternion(*origin[-4:]).conjugate  # since then, small
        return np.array([*values, 2 * turn.x, 2 * turn.y, 2 * turn.z])

    def _move(self, i: int, length: float) -> None:
        parts = self._parts()
        if i < len(parts):
            array, entry = parts[i]
            array[entry] += length
            return
        if self.scene.dimensions == 2:
            self.state[body.ANGLE] += length
        else:
            turn = [0.0, 0.0, 0.0]
            turn[i - len(parts)] = length
            q = self.state[body.QUATERNION : body.QUATERNION + 4]
            q[:] = list(numbers(exponential(Vector(*turn)) @ Quaternion(*q.tolist())))
        body.orient(BodyState(self.state))
