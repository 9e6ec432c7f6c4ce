"""Point masses and the hand that holds them, moved exactly over a sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.loop.plant import Hand

FloatArray = NDArray[np.float64]

# The state block. After the header stand position, velocity, effort, the target r, r' at the sample's beginning and at
# its end, (n, d) each; then room for one group's input, 6 n; the table of groups; their fingers; their matrices.
FINGERS = 0
DIMENSIONS = 1
GROUPS = 2
TABLE = 3  # where the table of groups starts
HEADER = 4
ARRAYS = 7
GROUP = 4  # entries of a group: axis, size, where its fingers are listed, where its matrix starts


class PointPlant:
    """Point masses and the hand that holds them, moved exactly while the efforts are held.

        m_i x_i'' + b_i x_i' = u_i + sum_j K_ij (r_j - x_j) + B_ij (r_j' - x_j')      on every axis

    Over each sample the intended positions r follow the cubic through their values and velocities at its two ends; for
    that r the motion is exact: a matrix exponential of the augmented system, made when the hand's gains or the period
    change. Fingers that no gain couples are moved by themselves. A hand's gains are looked at again when its arrays
    are other objects than before.

    Args:
        mass: (n,) [kg].
        friction: (n,) [N s/m].
        dimensions: d.
    """

    def __init__(self, mass: Sequence[float], friction: Sequence[float], dimensions: int) -> None:
        self._mass, self._friction = np.array(mass, dtype=float), np.array(friction, dtype=float)
        n, d = len(mass), dimensions
        table = HEADER + ARRAYS * n * d + 6 * n
        self.state: FloatArray = np.zeros(table + (GROUP + 1) * n * d + 12 * n * n * d)
        self.state[:HEADER] = n, d, 0, table
        arrays = self.state[HEADER : HEADER + ARRAYS * n * d].reshape(ARRAYS, n, d)
        self._position, self._velocity, self._effort, *course = arrays
        self._begin, self._end = (course[0], course[1]), (course[2], course[3])
        self._S: Any = self.state.data
        self._hand: Hand | None = None
        self._gains: tuple[FloatArray, FloatArray] | None = None
        self._T = 0.0
        self._since = 0.0  # the time at which the period was last changed, and the ticks since then
        self._count = 0
        self.ticks = 0
        self.placed = 0  # how often, so that a device knows that its finger was lifted

    @property
    def position(self) -> FloatArray:
        return self._position

    @property
    def velocity(self) -> FloatArray:
        return self._velocity

    @property
    def time(self) -> float:
        """Ticks times the period [s]."""
        return self._since + self._count * self._T

    def place(self, position: FloatArray) -> None:
        if np.shape(position) != self._position.shape or not np.isfinite(position).all():
            raise InputError("position", position, f"finite positions {self._position.shape} [m]")
        import scipy.linalg  # noqa: F401 (here, so that the first sample does not wait for it)

        self._position[...] = position
        self._velocity[...] = 0.0
        self._hand, self._since, self._count, self.ticks = None, 0.0, 0, 0
        self.placed += 1

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        K, B = hand.stiffness, hand.damping
        if self._gains is None or T != self._T or K is not self._gains[0] or B is not self._gains[1]:
            self._prepare(K, B, T)
        if hand is not self._hand:
            self._hand = hand
            self._begin[0][...], self._begin[1][...] = hand.target(self.time)
        self._count += 1
        self.ticks += 1
        self._end[0][...], self._end[1][...] = hand.target(self.time)
        self._effort[...] = force
        advance(self._S, 0)

    def _prepare(self, K: FloatArray, B: FloatArray, T: float) -> None:
        n, d = self._position.shape
        if not (math.isfinite(T) and T > 0.0):
            raise InputError("T", T, "a finite time above zero [s]")
        for name, gain in (("hand.stiffness", K), ("hand.damping", B)):
            if gain.shape != (d, n, n) or not np.isfinite(gain).all():
                raise InputError(name, gain, f"finite gains {(d, n, n)}, for {n} fingers in {d} dimensions")
        same = self._gains is not None and all(map(np.array_equal, (K, B), self._gains))
        if T != self._T:
            self._since, self._count, self._T = self.time, 0, T
        elif same:
            self._gains = K, B
            return
        self._gains = K, B
        S, m, b = self.state, self._mass, self._friction
        row = int(S[TABLE])
        members = row + GROUP * n * d
        end = members + n * d
        made: dict[tuple[bytes, ...], int] = {}
        S[GROUPS] = 0.0
        for axis in range(d):
            for group in _coupled((K[axis] != 0.0) | (B[axis] != 0.0)):
                size, block = len(group), np.ix_(group, group)
                parts = m[group], b[group], K[axis][block], B[axis][block]
                key = tuple(part.tobytes() for part in parts)
                if key not in made:
                    step = _step(*parts, T)
                    S[end : end + step.size] = step.ravel()
                    made[key] = end
                    end += step.size
                S[row : row + GROUP] = axis, size, members, made[key]
                S[members : members + size] = group
                row, members = row + GROUP, members + size
                S[GROUPS] += 1.0


def advance(S: Any, o: int) -> None:
    """One sample of the plant whose block starts at `o`; then the targets' end becomes their beginning.

    Per group of g coupled fingers on an axis: (x - x_0, x') = M (x_0 - r_0, x_0', u, r_1 - r_0, r_0', r_1').
    """
    n, d = int(S[o + FINGERS]), int(S[o + DIMENSIONS])
    step = n * d
    x = o + HEADER
    v, u = x + step, x + 2 * step
    r0, dr0, r1, dr1 = x + 3 * step, x + 4 * step, x + 5 * step, x + 6 * step
    q = x + ARRAYS * step
    table = o + int(S[o + TABLE])
    for group in range(int(S[o + GROUPS])):
        row = table + GROUP * group
        axis, g = int(S[row]), int(S[row + 1])
        members, top = o + int(S[row + 2]), o + int(S[row + 3])
        for j in range(g):
            i = int(S[members + j]) * d + axis
            S[q + j] = S[x + i] - S[r0 + i]
            S[q + g + j] = S[v + i]
            S[q + 2 * g + j] = S[u + i]
            S[q + 3 * g + j] = S[r1 + i] - S[r0 + i]
            S[q + 4 * g + j] = S[dr0 + i]
            S[q + 5 * g + j] = S[dr1 + i]
        width = 6 * g
        for j in range(g):
            i = int(S[members + j]) * d + axis
            a, b = top + j * width, top + (g + j) * width
            dx = dv = 0.0
            for k in range(width):
                dx += S[a + k] * S[q + k]
                dv += S[b + k] * S[q + k]
            S[x + i] += dx
            S[v + i] = dv
    for i in range(2 * step):
        S[r0 + i] = S[r1 + i]


def _step(m: FloatArray, b: FloatArray, K: FloatArray, B: FloatArray, T: float) -> FloatArray:
    """M (2 g, 6 g) of `advance`, from the exponential of the system with its inputs, in s = t / T.

    e = x - r_0, w = T x', rho = r - r_0 = c_1 s + c_2 s^2 + c_3 s^3:
    e' = w, w' = T^2/m (u + K (rho - e)) + T/m (B rho' - (b + B) w).
    """
    from scipy.linalg import expm

    g = len(m)
    I = np.eye(g)  # noqa: E741 (the identity's letter)
    per_mass = (T / m)[:, None]
    A = np.zeros((7, g, 7, g))  # blocks e, w, rho, rho', rho'', rho''', u
    A[0, :, 1], A[2, :, 3], A[3, :, 4], A[4, :, 5] = I, I, I, I
    A[1, :, 0], A[1, :, 2], A[1, :, 6] = -T * per_mass * K, T * per_mass * K, T * per_mass * I
    A[1, :, 1], A[1, :, 3] = -per_mass * (np.diag(b) + B), per_mass * B
    E = np.asarray(expm(A.reshape(7 * g, 7 * g))).reshape(7, g, 7, g)[:2]
    # At s = 0 rho' = c_1 = h_0, rho'' = 2 c_2 = 6 D - 4 h_0 - 2 h_1, rho''' = 6 c_3 = -12 D + 6 h_0 + 6 h_1,
    # D = r_1 - r_0, h = T r' (Hermite).
    M = np.empty((2, g, 6, g))
    M[:, :, 0], M[:, :, 1], M[:, :, 2] = E[:, :, 0], T * E[:, :, 1], E[:, :, 6]
    M[:, :, 3] = 6.0 * E[:, :, 4] - 12.0 * E[:, :, 5]
    M[:, :, 4] = T * (E[:, :, 3] - 4.0 * E[:, :, 4] + 6.0 * E[:, :, 5])
    M[:, :, 5] = T * (6.0 * E[:, :, 5] - 2.0 * E[:, :, 4])
    M[0, :, 0] -= I  # the change of x, so that what stands still does so exactly
    M[1] /= T
    return M.reshape(2 * g, 6 * g)


def _coupled(linked: NDArray[np.bool_]) -> list[list[int]]:
    """Groups of fingers that are linked, directly or through others, each in order."""
    left = list(range(len(linked)))
    groups = []
    while left:
        group = [left.pop(0)]
        for i in group:
            found = [j for j in left if linked[i, j] or linked[j, i]]
            group += found
            left = [j for j in left if j not in found]
        groups.append(sorted(group))
    return groups
