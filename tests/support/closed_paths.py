"""Closed paths of fingers and object, and the energy that a grasp gains around one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from graspfx.coupling.grasped import GraspedObject
from graspfx.objects import integrators as body
from graspfx.objects.body_state import BodyState

STEPS = 256  # of a smooth loop: the trapezoid rule is exact to rounding there


class Loop:
    """Smooth periodic curves of k numbers, and their derivatives, in a phase from 0 to 2 pi."""

    def __init__(self, rng: np.random.Generator, size: tuple[int, ...], amplitude: float) -> None:
        self.a, self.b = amplitude * rng.standard_normal((2, 3, *size)) / 3.0

    def at(self, phase: float) -> tuple[np.ndarray, np.ndarray]:
        k = np.arange(1, 4)
        c, s = np.cos(k * phase), np.sin(k * phase)
        x = np.tensordot(c - 1.0, self.a, 1) + np.tensordot(s, self.b, 1)
        return x, np.tensordot(-k * s, self.a, 1) + np.tensordot(k * c, self.b, 1)


def turned(u: np.ndarray, du: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """exp(u) as a quaternion x y z w, and the angular velocity in world axes while u changes by du."""
    t = float(np.linalg.norm(u))
    half = 0.5 * t
    q = np.append(np.sinc(half / np.pi) * 0.5 * u, np.cos(half))
    b = 0.5 * np.sinc(half / np.pi) ** 2  # (1 - cos t) / t^2
    c = (t - np.sin(t)) / t**3 if t > 1e-2 else 1.0 / 6.0 - t * t / 120.0
    return q, du + b * np.cross(u, du) + c * np.cross(u, np.cross(u, du))


def gain_per_loop(
    g: GraspedObject, start: np.ndarray, seed: int, turn: float = 0.6, steps: int = STEPS,
    ask: Callable[[GraspedObject], int] = GraspedObject.sample,
) -> float:  # fmt: skip
    """Work of fingers and of what holds the object around one closed loop, over the largest stored so far."""
    rng = np.random.default_rng(seed)
    n = len(start)
    fingers, shift, turns = Loop(rng, (n, 3), 0.004), Loop(rng, (3,), 0.01), Loop(rng, (3,), turn)
    power = []
    S = g.body_state
    for phase in np.linspace(0.0, 2.0 * np.pi, steps, endpoint=False):
        x, dx = shift.at(phase)
        q, w = turned(*turns.at(phase))
        S[body.POSITION : body.POSITION + 3] = x
        S[body.QUATERNION : body.QUATERNION + 4] = q
        body.orient(BodyState(S.data))
        R = S[body.ROTATION : body.ROTATION + 9].reshape(3, 3)
        e, de = fingers.at(phase)
        arm = start @ R.T + e @ R.T
        g.finger_position[:] = x + arm
        v = dx + np.cross(w, arm) + de @ R.T
        assert ask(g) == 0
        F, M = g.wrench[:3], g.wrench[3:]
        power.append((g.force * v).sum() - F @ dx - M @ w)
    work = np.cumsum(power) * 2.0 * np.pi / steps
    return float(work[-1] / np.abs(work).max())
