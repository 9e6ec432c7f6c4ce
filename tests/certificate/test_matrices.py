"""Each matrix of a linearisation against differences of one tick of the servo: a failure names the one that is wrong.

Every coordinate of a grasp at rest is moved a little to both sides, and the servo ticks once. Forces tell stiffness and
damping of the coupling; how devices and object move under the forces that were recorded tells, by least squares, what
they are by themselves: E = exp(A T) and Gamma of devices in hands, R and s of the object.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, logm

import graspfx as gx
from graspfx.analysis.linearisation import Linearisation
from graspfx.certificate.linearise import linearise
from tests.support.rested_run import RestedRun, TickDifferences

N, D = 3, 2  # fingers on a disc in the plane
M, R = N * D, 3
PLAIN: dict[str, Any] = {}
CASES: dict[str, dict[str, Any]] = {
    "sticking": PLAIN,
    "attached": {"coupling.contact": "attached"},
    "without friction": {"coupling.friction": 0.0, "object.free": [True, True, False]},
    "contact reaction": {"coupling.reaction": "contact"},
    "by masses": {"coupling.metric": "mass"},
    "exact": {"object.integrator": "exact"},
    "semi-implicit": {"object.integrator": "semi-implicit"},
    "undamped hands": {"finger.*.hand.damping": 0.0, "finger.*.device.damping": 1.6},
    "gains by finger": {"coupling.external.stiffness": [60.0, 80.0, 70.0], "coupling.form": "symmetric"},
}


def grasp(changes: dict[str, Any]) -> gx.Scene:
    """Three devices of unlike masses squeeze a disc evenly."""
    angles = 2.0 * np.pi * np.arange(N) / N + 0.4
    fingers = [
        {
            "device": {"name": "simulated", "mass": mass, "damping": friction},
            "start": (0.03 * np.array([np.cos(a), np.sin(a)])).tolist(),
            "hand": {
                "stiffness": 110.0, "damping": 1.4, "squeeze": 0.004, "squeeze_ramp": 0.2,
                "closing": [-np.cos(a), -np.sin(a)],
            },
        }
        for a, mass, friction in zip(angles, (0.1, 0.13, 0.17), (0.3, 0.4, 0.5), strict=True)
    ]  # fmt: skip
    scene = gx.Scene(
        dimensions=D,
        period=0.004,
        duration=2.4,
        object={
            "mass": 0.12, "viscosity": 0.9, "rotational_viscosity": 6e-4, "integrator": "explicit",
            "shape": {"kind": "sphere", "radius": 0.03},
        },
        coupling={
            "friction": 0.8, "absent": "follow", "damping_depth": 0.0,
            "external": {"stiffness": 60.0, "damping": 0.15}, "internal": {"stiffness": 90.0, "damping": 0.25},
        },
        finger=fingers,
    )  # fmt: skip
    return scene.replace(changes)


class Measured:
    """One tick's differences at the rest of a run, with the linearisation at that rest."""

    def __init__(self, name: str) -> None:
        self.scene = grasp(CASES[name])
        self.T = self.scene.period
        run = RestedRun(self.scene, self.scene.duration)
        self.free = np.array(self.scene.free(self.scene.object[0]))
        self.linear: Linearisation = linearise(self.scene, "recorded", recording=run.recording).linear
        self.tick: TickDifferences = run.tick_differences()
        run.close()
        # the state's coordinates: x, x', last readings, then the object's position, velocity, spin and turn
        self.x, self.v, self.old = (slice(k * M, k * M + M) for k in range(3))
        q, w = 3 * M + np.arange(D), 3 * M + D + np.arange(D + 1)
        self.q, self.w = np.append(q, 3 * M + 2 * D + 1)[self.free], w[self.free]

    @property
    def preload(self) -> np.ndarray:
        r = int(self.free.sum())
        return np.zeros((M + r, M + r)) if self.linear.preload is None else self.linear.preload

    def devices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M, K_h and b + B_h of devices in hands, by the logarithm of how they move without a force."""
        before = np.vstack([np.eye(self.tick.after.shape[1])[: 2 * M], -self.tick.force])
        after = self.tick.after[: 2 * M]
        # in units in which positions, velocities and forces count alike
        unit = np.concatenate([np.ones(M), np.full(M, self.T), np.full(M, self.T**2 / 0.1)])
        moved = np.linalg.lstsq((unit[:, None] * before).T, after.T, rcond=1e-10)[0].T * unit
        E, hold = moved[:, : 2 * M], moved[:, 2 * M :]
        A = np.real(logm(E)) / self.T
        per_mass = (A @ np.linalg.solve(E - np.eye(2 * M), hold))[M:]
        mass = np.linalg.inv(per_mass)
        return mass, -mass @ A[M:, :M], -mass @ A[M:, M:]

    def object(self) -> tuple[np.ndarray, np.ndarray]:
        """Inertia and viscosity of the object, by how its velocity changes under a wrench."""
        rows = np.eye(self.tick.after.shape[1])[self.w]
        before = np.vstack([rows, self.T * self.tick.wrench[self.free]])
        scale = np.abs(before).max(axis=1)
        moved = np.linalg.lstsq((before / scale[:, None]).T, self.tick.after[self.w].T, rcond=1e-12)[0].T / scale
        r = len(rows)
        decay, push = moved[:, :r], self.T * moved[:, r:]
        if self.linear.integrator == "exact":  # s = (1 - R) B^-1, R = exp(-M^-1 B T)
            viscosity = np.linalg.solve(push.T, (np.eye(r) - decay).T).T
            return viscosity @ np.linalg.inv(-np.real(logm(decay)) / self.T), viscosity
        inertia = self.T * np.linalg.inv(push)  # s = T M^-1, R = 1 - T M^-1 B
        return inertia, inertia @ (np.eye(r) - decay) / self.T


@cache
def measured(name: str) -> Measured:
    return Measured(name)


def assert_close(found: np.ndarray, expected: np.ndarray, part: float = 2e-5) -> None:
    """To a part of the largest entry: differences of 1e-7 m over a squeeze of some millimetres."""
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=part * np.abs(expected).max())


CASE = pytest.mark.parametrize("name", CASES)


@CASE
def test_stiffness(name: str) -> None:
    """df/dx and the last reading with it: K, and what the preload adds."""
    this = measured(name)
    found = this.tick.force[:, this.x] + this.tick.force[:, this.old]
    assert_close(found, this.linear.stiffness + this.preload[:M, :M])


@CASE
def test_levers_of_the_displacement(name: str) -> None:
    """df/dq = -K G_e', and what the preload adds."""
    this = measured(name)
    found = this.tick.force[:, this.q]
    assert_close(found, this.preload[:M, M:] - this.linear.stiffness @ this.linear.G_displacement.T)


@CASE
def test_damping(name: str) -> None:
    """df/d(last reading) = -D/T, df/dw = -D G'."""
    this = measured(name)
    assert_close(-this.T * this.tick.force[:, this.old], this.linear.damping)
    assert_close(-this.tick.force[:, this.w], this.linear.damping @ this.linear.G.T)


@CASE
def test_wrench(name: str) -> None:
    """The wrench is G f, less what the preload takes."""
    this = measured(name)
    found = this.tick.wrench[this.free]
    moved = np.eye(found.shape[1])
    rest = this.preload @ np.vstack([moved[this.x], moved[this.q]])
    forces = this.tick.force - rest[:M]  # G acts on the coupling's own; what the preload adds has rows of its own
    assert_close(found, this.linear.G @ forces - rest[M:])


@pytest.mark.parametrize("name", [name for name in CASES if name != "without friction"])  # has forces every way
def test_devices_and_hands(name: str) -> None:
    """Masses, the hands' stiffness, and friction and the hands' damping together."""
    this, linear = measured(name), measured(name).linear
    mass, stiffness, damping = this.devices()
    assert_close(mass, np.diag(linear.mass), 1e-4)
    assert_close(stiffness, linear.hand_stiffness, 1e-4)
    assert_close(damping, np.diag(linear.friction) + linear.hand_damping, 1e-4)


def test_friction_of_devices_by_itself() -> None:
    this = measured("undamped hands")
    assert not this.linear.hand_damping.any()
    assert_close(this.devices()[2], np.diag(this.linear.friction), 1e-4)


@CASE
def test_object(name: str) -> None:
    """Inertia and viscosity, rotation with its own."""
    this, linear = measured(name), measured(name).linear
    inertia, viscosity = this.object()
    unit = np.sqrt(np.diag(linear.inertia))
    assert_close(inertia / np.outer(unit, unit), linear.inertia / np.outer(unit, unit), 1e-4)
    assert_close(viscosity / np.outer(unit, unit), linear.viscosity / np.outer(unit, unit), 1e-4)


def test_the_measures_are_those_of_known_matrices() -> None:
    """The logarithm and the hold give back what a device was made of."""
    mass, stiffness, damping, T = 0.1, 110.0, 1.8, 0.004
    A = np.array([[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, 1.0 / mass], [0.0, 0.0, 0.0]])
    E, hold = expm(T * A)[:2, :2], expm(T * A)[:2, 2:]
    back = np.real(logm(E)) / T
    assert (back @ np.linalg.solve(E - np.eye(2), hold))[1, 0] == pytest.approx(1.0 / mass, rel=1e-9)
    assert -mass * back[1] == pytest.approx([stiffness, damping], rel=1e-9)


@pytest.mark.parametrize("delays", [(0, 1, 2), (2, 2, 0)])
def test_delay(delays: tuple[int, ...]) -> None:
    """A push of the object is felt by each device after as many samples as its matrix has."""
    scene = grasp(
        {f"finger.{i}.device.delay": delay for i, delay in enumerate(delays)} | {"coupling.contact": "attached"}
    )
    linear = linearise(scene, "start").linear
    runs = [gx.run(scene.replace({"object.velocity": [v, 0.5 * v], "object.angular_velocity": 20.0 * v}), duration=0.04)
            for v in (0.0, 1e-4)]  # fmt: skip
    x = runs[1].true_position - runs[0].true_position  # type: ignore[operator]
    f = runs[1].finger_force - runs[0].finger_force
    for i in range(N):
        first = int(np.flatnonzero(np.abs(f[:, i]).max(axis=1) > 0.0)[0])
        felt = int(np.flatnonzero(np.abs(x[:, i]).max(axis=1) > 0.0)[0])
        assert felt - first - 1 == linear.delay[D * i] == delays[i]
