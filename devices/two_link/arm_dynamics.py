"""The motion of two-link arms that one hand holds together: rigid-body dynamics, integrated over a sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import (
    BEGIN,
    DIMENSIONS,
    EFFORT,
    END,
    FINGERS,
    MIDDLE,
    OWN,
    PERIOD,
    TICKS,
    VELOCITY,
    HeldPlant,
    unfit,
)
from graspfx.devices.two_link.arm import Mechanics

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

# The block's own part: where the states of the arms start, room for eight more of each, the hand's gains (K, then B,
# (2, n, n) each) and the arms' constants. They stand after the arrays.
STATES, WORK, GAINS, ARMS = range(OWN, OWN + 4)
HEADER = OWN + 4

# One arm's constants, and what is worked out for it.
BASE, LINKS = 0, 2  # 2 each
I1, I2, MIXED, ROTORS, D1, D12, D2 = range(4, 11)  # Mechanics.constants
ELBOW = 11  # 1 if the second motor sits at the elbow
TORQUE = 12  # 2, by the directions of the links, held over the sample
JACOBIAN = 14  # 4, row-major, where the derivative was last taken
ERROR, ERROR_RATE = 18, 20  # 2 each: the hand's target less the finger
COURSE = 22  # 12: the target over the sample in powers of u = time/T up to the fifth, x then y
ARM = 34

STATE = 4  # a1, a2 [rad], a1', a2' [rad/s] of each arm
STAGES = 7
STEP = 0.12  # largest (fastest rate of arm and hand) x (substep)
MOST = 1000  # substeps

TOO_FAST = 2  # what `advance` gives besides NOT_FINITE, 1


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


def integrate(S: Any, o: int, substeps: int) -> None:
    """The arms' states a sample later: Butcher's sixth-order method in seven stages (1964), in equal substeps.

    Sixth order, because at 5 ms one substep of it costs less than the ten of the classical fourth-order method that
    reach the same error.
    """
    n, T = int(S[o + FINGERS]), S[o + PERIOD]
    y, z, K, arms = o + int(S[o + STATES]), o + int(S[o + WORK]), o + int(S[o + GAINS]), o + int(S[o + ARMS])
    B = K + 2 * n * n
    N = STATE * n
    k1 = z + N
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


def fastest_rate(S: Any, o: int) -> float:
    """An upper estimate of how fast arms and hand move, [rad/s]: it sets the number of substeps."""
    n = int(S[o + FINGERS])
    y, K, arms = o + int(S[o + STATES]), o + int(S[o + GAINS]), o + int(S[o + ARMS])
    B = K + 2 * n * n
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
        c = arms + ARM * i
        s = y + STATE * i
        half = 0.5 * (S[c + I1] + S[c + I2])
        mixed = abs(S[c + MIXED]) + abs(S[c + ROTORS])
        least = half - math.sqrt(0.25 * (S[c + I1] - S[c + I2]) ** 2 + mixed * mixed)  # eigenvalue of M, any posture
        longer = max(S[c + LINKS], S[c + LINKS + 1])
        rate = max(
            rate,
            math.sqrt(stiffness * longer * longer / least),
            (damping * longer * longer + max(S[c + D1], S[c + D2])) / least,
            2.0 * abs(S[s + 2]),
            2.0 * abs(S[s + 3]),
        )
    return rate


def course(S: Any, c: int, start: int, middle: int, end: int, rate: int, T: float) -> None:
    """The fifth-order polynomial in u = time/T from `c` through a target at the beginning, the middle and the end.

    Each of the three is where its position stands; its velocity stands `rate` further on.
    """
    r, h = S[start], S[start + rate] * T
    # What is left of the middle and the end after r + h u, and of their rates after h.
    C = S[middle] - r - 0.5 * h
    D = S[middle + rate] * T - h
    A = S[end] - r - h
    B = S[end + rate] * T - h
    c2 = 16.0 * C - 8.0 * D + 7.0 * A - B
    c3 = 32.0 * C - 6.0 * A + B - 4.0 * c2
    S[c] = r
    S[c + 1] = h
    S[c + 2] = c2
    S[c + 3] = c3
    S[c + 4] = 5.0 * A - B - 3.0 * c2 - 2.0 * c3
    S[c + 5] = B - 4.0 * A + 2.0 * c2 + c3


def show(S: Any, o: int) -> None:
    """The tips' positions and velocities, from the arms' states."""
    n = int(S[o + FINGERS])
    y, arms, x = o + int(S[o + STATES]), o + int(S[o + ARMS]), o + HEADER
    v = x + VELOCITY * 2 * n
    for i in range(n):
        c, s, k = arms + ARM * i, y + STATE * i, 2 * i
        a1, a2, w1, w2 = S[s], S[s + 1], S[s + 2], S[s + 3]
        l1, l2 = S[c + LINKS], S[c + LINKS + 1]
        x1, y1 = l1 * math.cos(a1), l1 * math.sin(a1)
        x2, y2 = l2 * math.cos(a2), l2 * math.sin(a2)
        S[x + k] = S[c + BASE] + x1 + x2
        S[x + k + 1] = S[c + BASE + 1] + y1 + y2
        S[v + k] = -y1 * w1 - y2 * w2
        S[v + k + 1] = x1 * w1 + x2 * w2


def advance(S: Any, o: int) -> int:
    """One sample of the plant whose block starts at `o`; then the targets' end becomes their beginning.

    0; NOT_FINITE or TOO_FAST if it stays where it is.
    """
    n, T = int(S[o + FINGERS]), S[o + PERIOD]
    step = 2 * n
    x = o + HEADER
    u, begin, end, middle = x + EFFORT * step, x + BEGIN * step, x + END * step, x + MIDDLE * step
    code: int = unfit(S, u, middle + 2 * step, step)
    if code:
        return code
    rate = fastest_rate(S, o)
    if not rate * T < STEP * MOST:
        return TOO_FAST
    arms = o + int(S[o + ARMS])
    for i in range(n):
        c, k = arms + ARM * i, 2 * i
        t1, t2 = S[u + k], S[u + k + 1]
        S[c + TORQUE] = t1 - t2 if S[c + ELBOW] != 0.0 else t1
        S[c + TORQUE + 1] = t2
        course(S, c + COURSE, begin + k, middle + k, end + k, step, T)
        course(S, c + COURSE + 6, begin + k + 1, middle + k + 1, end + k + 1, step, T)
    integrate(S, o, math.floor(rate * T / STEP) + 1)
    show(S, o)
    for i in range(2 * step):
        S[begin + i] = S[end + i]
    S[o + TICKS] += 1.0
    return 0


class ArmPlant(HeldPlant):  # type: ignore[misc] # mypy does not see the shelf from inside the package
    """Two-link arms, joint torques [N m] held over the sample, and the hand at their tips, moved together.

    No gravity: the arms move in a horizontal plane. The hand's targets are followed through their positions and
    velocities at both ends and the middle of each sample. Substeps are chosen so that the tips stay within 1e-10 m
    of the exact motion.
    """

    kernel = staticmethod(advance)

    def __init__(self, mechanics: Sequence[Mechanics]) -> None:
        n = len(mechanics)
        self._geometry = [m.arm for m in mechanics]
        sizes = STATE * n, (STAGES + 1) * STATE * n, 4 * n * n, ARM * n
        super().__init__(n, 2, header=HEADER, middle=True, own=sum(sizes))
        y = len(self.state) - sum(sizes)
        K = y + sizes[0] + sizes[1]
        arms = K + sizes[2]
        self.state[STATES:HEADER] = y, y + sizes[0], K, arms
        self._angles: Any = [self._S[o : o + STATE] for o in range(y, y + sizes[0], STATE)]
        self._stiffness, self._damping = self.state[K:arms].reshape(2, 2, n, n)
        for i, m in enumerate(mechanics):
            o = arms + ARM * i
            self.state[o : o + TORQUE] = [*m.arm.base, *m.arm.links, *m.constants, m.arm.drive == "elbow"]
            base, away = m.arm.base, math.hypot(*m.arm.links)
            self._turn(i, *m.arm.angles(base[0], base[1] + away))  # at home: the elbow at a right angle
        show(self._S, 0)

    @property
    def structure(self) -> Index:
        """Counts, where things stand, and where each arm's second motor sits."""
        front = [FINGERS, DIMENSIONS, STATES, WORK, GAINS, ARMS]
        return np.append(front, int(self.state[ARMS]) + ELBOW + ARM * np.arange(len(self.position)))

    def sensed(self, i: int) -> Index:
        """Entries of the block where a1 and a2 of arm i stand."""
        return int(self.state[STATES]) + STATE * i + np.arange(2)

    def angles(self, i: int) -> memoryview:
        """a1, a2, a1', a2' of arm i, seen by its encoders; the same memory for the plant's life."""
        view: memoryview = self._angles[i]
        return view

    def fault_text(self, code: int) -> str:
        if code != TOO_FAST:
            text: str = super().fault_text(code)
            return text
        rate, T = fastest_rate(self._S, 0), self._S[PERIOD]
        return (
            f"two-link arms and hand move at {rate:.3g} rad/s, too fast for samples of {T:g} s: the motion has "
            "diverged, or the hand is too stiff"
        )

    def _put(self, position: FloatArray) -> None:
        found = [arm.angles(x, y) for arm, (x, y) in zip(self._geometry, position.tolist(), strict=True)]
        for i, (a1, a2) in enumerate(found):
            self._turn(i, a1, a2)

    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        self._stiffness[...] = K
        self._damping[...] = B

    def _turn(self, i: int, a1: float, a2: float) -> None:
        at = self._angles[i]
        at[0], at[1], at[2], at[3] = a1, a2, 0.0, 0.0
