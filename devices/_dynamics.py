"""The motion of two-link arms that one hand holds together: rigid-body dynamics, integrated over a sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._arm import Mechanics
from graspfx.errors import DeviceError, InputError
from graspfx.loop.plant import Hand

FloatArray = NDArray[np.float64]

# One arm's part of the state block.
BASE, LINKS = 0, 2  # 2 each
I1, I2, MIXED, ROTORS, D1, D12, D2 = range(4, 11)  # Mechanics.constants
TORQUE = 11  # 2, by the directions of the links, held over the sample
JACOBIAN = 13  # 4, row-major, where the derivative was last taken
ERROR, ERROR_RATE = 17, 19  # 2 each: the hand's target less the finger
COURSE = 21  # 12: the target over the sample in powers of u = time/T up to the fifth, x then y
ARM = 33

STATE = 4  # a1, a2 [rad], a1', a2' [rad/s] of each arm
STAGES = 7
STEP = 0.12  # largest (fastest rate of arm and hand) x (substep)
MOST = 1000  # substeps


def derivative(S: Any, n: int, arms: int, K: int, B: int, y: int, out: int, u: float, T: float) -> None:
    """M(a) a'' = tau + J'F - D a' + m sin(a2 - a1) (a2'^2, -a1'^2), with F = K (r - p) + B (r' - v) on the fingers.

    The states of the n arms stand from `y`, their derivatives are left from `out`; u is the time in the sample over T.
    K and B are (2, n, n): axis, finger, finger.
    """
    for i in range(n):
        o = arms + ARM * i
        s = y + STATE * i
        a1, a2, w1, w2 = S[s], S[s + 1], S[s + 2], S[s + 3]
        l1, l2 = S[o + LINKS], S[o + LINKS + 1]
        x1, y1 = l1 * math.cos(a1), l1 * math.sin(a1)
        x2, y2 = l2 * math.cos(a2), l2 * math.sin(a2)
        S[o + JACOBIAN] = -y1
        S[o + JACOBIAN + 1] = -y2
        S[o + JACOBIAN + 2] = x1
        S[o + JACOBIAN + 3] = x2
        c = o + COURSE
        c1, c2, c3, c4, c5 = S[c + 1], S[c + 2], S[c + 3], S[c + 4], S[c + 5]
        r = S[c] + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        dr = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / T
        S[o + ERROR] = r - (S[o + BASE] + x1 + x2)
        S[o + ERROR_RATE] = dr + y1 * w1 + y2 * w2
        c += 6
        c1, c2, c3, c4, c5 = S[c + 1], S[c + 2], S[c + 3], S[c + 4], S[c + 5]
        r = S[c] + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        dr = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / T
        S[o + ERROR + 1] = r - (S[o + BASE + 1] + y1 + y2)
        S[o + ERROR_RATE + 1] = dr - x1 * w1 - x2 * w2
    for i in range(n):
        o = arms + ARM * i
        s = y + STATE * i
        fx = 0.0
        fy = 0.0
        for j in range(n):
            e = arms + ARM * j
            kx = n * i + j
            ky = n * (n + i) + j
            fx += S[K + kx] * S[e + ERROR] + S[B + kx] * S[e + ERROR_RATE]
            fy += S[K + ky] * S[e + ERROR + 1] + S[B + ky] * S[e + ERROR_RATE + 1]
        w1, w2 = S[s + 2], S[s + 3]
        j11, j12, j21, j22 = S[o + JACOBIAN], S[o + JACOBIAN + 1], S[o + JACOBIAN + 2], S[o + JACOBIAN + 3]
        links = S[o + LINKS] * S[o + LINKS + 1]
        turn = S[o + MIXED] * (j12 * j21 - j11 * j22) / -links  # m sin(a2 - a1)
        mixed = S[o + MIXED] * (j11 * j12 + j21 * j22) / links + S[o + ROTORS]
        q1 = S[o + TORQUE] + j11 * fx + j21 * fy - S[o + D1] * w1 - S[o + D12] * w2 + turn * w2 * w2
        q2 = S[o + TORQUE + 1] + j12 * fx + j22 * fy - S[o + D12] * w1 - S[o + D2] * w2 - turn * w1 * w1
        determinant = S[o + I1] * S[o + I2] - mixed * mixed
        r = out + STATE * i
        S[r] = w1
        S[r + 1] = w2
        S[r + 2] = (S[o + I2] * q1 - mixed * q2) / determinant
        S[r + 3] = (S[o + I1] * q2 - mixed * q1) / determinant


def advance_arms(S: Any, n: int, arms: int, K: int, B: int, y: int, work: int, T: float, substeps: int) -> None:
    """The states from `y` after T seconds: Butcher's sixth-order method in seven stages (1964), in equal substeps.

    Sixth order, because at 5 ms one substep of it costs less than the ten of the classical fourth-order method that
    reach the same error. `work` has room for eight states.
    """
    N = STATE * n
    z = work
    k1 = work + N
    k2, k3, k4, k5, k6, k7 = k1 + N, k1 + 2 * N, k1 + 3 * N, k1 + 4 * N, k1 + 5 * N, k1 + 6 * N
    h = T / substeps
    for step in range(substeps):
        derivative(S, n, arms, K, B, y, k1, step / substeps, T)
        for i in range(N):
            S[z + i] = S[y + i] + h * S[k1 + i] / 3.0
        derivative(S, n, arms, K, B, z, k2, (step + 1.0 / 3.0) / substeps, T)
        for i in range(N):
            S[z + i] = S[y + i] + h * S[k2 + i] * 2.0 / 3.0
        derivative(S, n, arms, K, B, z, k3, (step + 2.0 / 3.0) / substeps, T)
        for i in range(N):
            S[z + i] = S[y + i] + h * (S[k1 + i] + 4.0 * S[k2 + i] - S[k3 + i]) / 12.0
        derivative(S, n, arms, K, B, z, k4, (step + 1.0 / 3.0) / substeps, T)
        for i in range(N):
            S[z + i] = S[y + i] + h * (18.0 * S[k2 + i] - S[k1 + i] - 3.0 * S[k3 + i] - 6.0 * S[k4 + i]) / 16.0
        derivative(S, n, arms, K, B, z, k5, (step + 0.5) / substeps, T)
        for i in range(N):
            S[z + i] = S[y + i] + h * (9.0 * S[k2 + i] - 3.0 * S[k3 + i] - 6.0 * S[k4 + i] + 4.0 * S[k5 + i]) / 8.0
        derivative(S, n, arms, K, B, z, k6, (step + 0.5) / substeps, T)
        for i in range(N):
            S[z + i] = (
                S[y + i]
                + h
                * (9.0 * S[k1 + i] - 36.0 * S[k2 + i] + 63.0 * S[k3 + i] + 72.0 * S[k4 + i] - 64.0 * S[k6 + i])
                / 44.0
            )
        derivative(S, n, arms, K, B, z, k7, (step + 1.0) / substeps, T)
        for i in range(N):
            S[y + i] += (
                h
                * (11.0 * (S[k1 + i] + S[k7 + i]) + 81.0 * (S[k3 + i] + S[k4 + i]) - 32.0 * (S[k5 + i] + S[k6 + i]))
                / 120.0
            )


def fastest_rate(S: Any, n: int, arms: int, K: int, B: int, y: int) -> float:
    """An upper estimate of how fast arms and hand move, [rad/s]: it sets the number of substeps."""
    stiffness = 0.0
    damping = 0.0
    for row in range(2 * n):
        k = 0.0
        b = 0.0
        for j in range(n):
            k += abs(S[K + n * row + j])
            b += abs(S[B + n * row + j])
        stiffness = max(stiffness, k)
        damping = max(damping, b)
    rate = 0.0
    for i in range(n):
        o = arms + ARM * i
        s = y + STATE * i
        half = 0.5 * (S[o + I1] + S[o + I2])
        mixed = abs(S[o + MIXED]) + abs(S[o + ROTORS])
        least = half - math.sqrt(0.25 * (S[o + I1] - S[o + I2]) ** 2 + mixed * mixed)  # eigenvalue of M, any posture
        longer = max(S[o + LINKS], S[o + LINKS + 1])
        rate = max(
            rate,
            math.sqrt(stiffness * longer * longer / least),
            (damping * longer * longer + max(S[o + D1], S[o + D2])) / least,
            2.0 * abs(S[s + 2]),
            2.0 * abs(S[s + 3]),
        )
    return rate


def _aim(hand: Hand, time: float) -> tuple[list[list[float]], list[list[float]]]:
    r, v = hand.target(time)
    return r.tolist(), v.tolist()


class ArmPlant:
    """Two-link arms, joint torques held over the sample, and the hand at their tips, moved together.

    No gravity: the arms move in a horizontal plane. The hand's targets are followed through their positions and
    velocities at both ends and the middle of each sample. Substeps are chosen so that the tips stay within 1e-10 m
    of the exact motion.
    """

    def __init__(self, mechanics: Sequence[Mechanics]) -> None:
        n = len(mechanics)
        self._geometry = [m.arm for m in mechanics]
        # The block that the kernels work on, and where its parts start: the arguments of `advance_arms`.
        self.n = n
        self.y = 0
        self.work = STATE * n
        self.K = self.work + (STAGES + 1) * STATE * n
        self.B = self.K + 2 * n * n
        self.arms = self.B + 2 * n * n
        self.state = np.zeros(self.arms + ARM * n)
        self._S: Any = self.state.data  # plain floats, where items of an array cost twice as much
        self._stiffness = self.state[self.K : self.B].reshape(2, n, n)
        self._damping = self.state[self.B : self.arms].reshape(2, n, n)
        self._position, self._velocity = np.zeros((n, 2)), np.zeros((n, 2))
        for i, m in enumerate(mechanics):
            o = self.arms + ARM * i
            self.state[o : o + 11] = [*m.arm.base, *m.arm.links, *m.constants]
            x, y = m.arm.base
            self._put(i, *m.arm.angles(x, y + math.hypot(*m.arm.links)))  # at home: the elbow at a right angle
        self.placed = 0  # how often
        self.ticks = 0  # since T changed
        self._start, self._T = 0.0, 0.0
        self._hand: Hand | None = None
        self._target: tuple[list[list[float]], list[list[float]]] = ([], [])
        self._show()

    @property
    def position(self) -> FloatArray:
        return self._position

    @property
    def velocity(self) -> FloatArray:
        return self._velocity

    @property
    def time(self) -> float:
        """Since `place` [s]."""
        return self._start + self.ticks * self._T

    def angles(self, i: int) -> memoryview:
        """a1, a2, a1', a2' of arm i, seen by its encoders; the same memory for the plant's life."""
        view: memoryview = self._S[self.y + STATE * i : self.y + STATE * (i + 1)]
        return view

    def place(self, position: FloatArray) -> None:
        """Put the fingers at these positions (n, 2) [m], at rest, at time zero; DeviceError out of an arm's reach."""
        p = np.asarray(position, dtype=np.float64)
        if p.shape != (self.n, 2) or not np.isfinite(p).all():
            raise InputError("position", position, f"finite positions of shape ({self.n}, 2) [m]")
        found = [arm.angles(x, y) for arm, (x, y) in zip(self._geometry, p.tolist(), strict=True)]
        for i, (a1, a2) in enumerate(found):
            self._put(i, a1, a2)
        self.placed += 1
        self.ticks, self._start, self._T = 0, 0.0, 0.0
        self._hand = None
        self._show()
        self._position[:] = p  # as asked, not as rounded through the angles

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Move for T seconds under joint torques `force` (n, 2) [N m], held, and the hand."""
        if force.shape != (self.n, 2) or not np.isfinite(force).all():
            raise InputError("force", force, f"finite joint torques of shape ({self.n}, 2) [N m]")
        S, n = self._S, self.n
        self._stiffness[:] = hand.stiffness
        self._damping[:] = hand.damping
        if T != self._T:
            self._start, self._T, self.ticks = self.time, T, 0
        begins = self.time
        self.ticks += 1
        ends = self.time
        if hand is not self._hand:
            self._hand, self._target = hand, _aim(hand, begins)
        start, middle, end = self._target, _aim(hand, 0.5 * (begins + ends)), _aim(hand, ends)
        self._target = end
        for i, arm in enumerate(self._geometry):
            o = self.arms + ARM * i
            t1, t2 = force[i].tolist()
            S[o + TORQUE] = t1 if arm.drive == "base" else t1 - t2
            S[o + TORQUE + 1] = t2
            for axis in (0, 1):
                r, h = start[0][i][axis], start[1][i][axis] * T
                # What is left of the middle and the end after r + h u, and of their rates after h.
                C = middle[0][i][axis] - r - 0.5 * h
                D = middle[1][i][axis] * T - h
                A = end[0][i][axis] - r - h
                B = end[1][i][axis] * T - h
                c2 = 16.0 * C - 8.0 * D + 7.0 * A - B
                c3 = 32.0 * C - 6.0 * A + B - 4.0 * c2
                c = o + COURSE + 6 * axis
                S[c] = r
                S[c + 1] = h
                S[c + 2] = c2
                S[c + 3] = c3
                S[c + 4] = 5.0 * A - B - 3.0 * c2 - 2.0 * c3
                S[c + 5] = B - 4.0 * A + 2.0 * c2 + c3
        rate = fastest_rate(S, n, self.arms, self.K, self.B, self.y)
        if not rate * T < STEP * MOST:
            raise DeviceError(
                f"two-link arms and hand move at {rate:.3g} rad/s, too fast for samples of {T:g} s: the motion has "
                "diverged, or the hand is too stiff"
            )
        substeps = math.floor(rate * T / STEP) + 1
        advance_arms(S, n, self.arms, self.K, self.B, self.y, self.work, T, substeps)
        self._show()

    def _put(self, i: int, a1: float, a2: float) -> None:
        self.state[self.y + STATE * i : self.y + STATE * (i + 1)] = a1, a2, 0.0, 0.0

    def _show(self) -> None:
        S = self._S
        for i, arm in enumerate(self._geometry):
            s = self.y + STATE * i
            a1, a2, w1, w2 = S[s], S[s + 1], S[s + 2], S[s + 3]
            l1, l2 = arm.links
            x1, y1, x2, y2 = l1 * math.cos(a1), l1 * math.sin(a1), l2 * math.cos(a2), l2 * math.sin(a2)
            self._position[i] = arm.base[0] + x1 + x2, arm.base[1] + y1 + y2
            self._velocity[i] = -y1 * w1 - y2 * w2, x1 * w1 + x2 * w2
