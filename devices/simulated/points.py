"""Point masses and the hand that holds them, moved exactly over a sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import (
    ARRAYS,
    BEGIN,
    DIMENSIONS,
    EFFORT,
    END,
    FINGERS,
    OWN,
    STILL,
    TICKS,
    VELOCITY,
    HeldPlant,
    unfit,
)
from graspfx.exponential import expm1

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

# The block's own part: how many groups there are and where their table starts. After the arrays: room for one group's
# input, 6 n; the table of groups; their fingers; their matrices.
GROUPS = OWN
TABLE = OWN + 1
HEADER = OWN + 2
GROUP = 4  # entries of a group: axis, size, where its fingers are listed, where its matrix starts


def advance(S: Any, o: int) -> int:
    """One sample of the plant whose block starts at `o`; then the targets' end becomes their beginning.

    Per group of g coupled fingers on an axis: (x - x_0, x') = M (x_0 - r_0, x_0', u, r_1 - r_0, r_0', r_1'); the
    last three are zero where the targets stand still.
    """
    n, d = int(S[o + FINGERS]), int(S[o + DIMENSIONS])
    step = n * d
    x = o + HEADER
    v, u = x + VELOCITY * step, x + EFFORT * step
    r0, r1 = x + BEGIN * step, x + END * step
    dr0, dr1 = r0 + step, r1 + step
    q = x + ARRAYS * step
    still = S[o + STILL] != 0.0
    code: int = unfit(S, u, u + step if still else q, step)
    if code:
        return code
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
            if not still:
                S[q + 3 * g + j] = S[r1 + i] - S[r0 + i]
                S[q + 4 * g + j] = S[dr0 + i]
                S[q + 5 * g + j] = S[dr1 + i]
        width = 6 * g
        for j in range(g):
            i = int(S[members + j]) * d + axis
            a, b = top + j * width, top + (g + j) * width
            dx = dv = 0.0
            for k in range(3 * g if still else width):
                dx += S[a + k] * S[q + k]
                dv += S[b + k] * S[q + k]
            S[x + i] += dx
            S[v + i] = dv
    if not still:
        for i in range(2 * step):
            S[r0 + i] = S[r1 + i]
    S[o + TICKS] += 1.0
    return 0


class PointPlant(HeldPlant):  # type: ignore[misc] # mypy does not see the shelf from inside the package
    """Point masses and the hand that holds them, moved exactly while the efforts are held.

        m_i x_i'' + b_i x_i' = u_i + sum_j K_ij (r_j - x_j) + B_ij (r_j' - x_j')      on every axis

    Over each sample the intended positions r follow the cubic through their values and velocities at its two ends; for
    that r the motion is exact: a matrix exponential of the augmented system, made when the hand's gains or the period
    change. Fingers that no gain couples are moved by themselves.

    Args:
        mass: (n,) [kg].
        damping: (n,) [N s/m].
        dimensions: d.
    """

    kernel = staticmethod(advance)

    def __init__(self, mass: Sequence[float], damping: Sequence[float], dimensions: int) -> None:
        n, d = len(mass), dimensions
        own = 6 * n + (GROUP + 1) * n * d + 12 * n * n * d
        super().__init__(n, d, header=HEADER, middle=False, own=own)
        self.state[TABLE] = HEADER + ARRAYS * n * d + 6 * n
        self._mass, self._damping = np.array(mass, dtype=float), np.array(damping, dtype=float)
        self._made_for: tuple[bytes, bytes, float] | None = None

    @property
    def structure(self) -> Index:
        """Counts, whether targets stand still, and the groups of coupled fingers: how many, their table and members."""
        row, entries = int(self.state[TABLE]), self.position.size
        members = row + GROUP * entries
        rows = np.arange(row, row + GROUP * int(self.state[GROUPS]))
        return np.concatenate(
            [[FINGERS, DIMENSIONS, STILL, GROUPS, TABLE], rows, np.arange(members, members + entries)]
        )

    def _put(self, position: FloatArray) -> None:
        """There is nothing else to place."""

    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        these = K.tobytes(), B.tobytes(), T
        if these == self._made_for:
            return
        n, d = self.position.shape
        S, m, b = self.state, self._mass, self._damping
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
        self._made_for = these


def _step(m: FloatArray, b: FloatArray, K: FloatArray, B: FloatArray, T: float) -> FloatArray:
    """M (2 g, 6 g) of `advance`, from the exponential of the system with its inputs, in s = t / T.

    e = x - r_0, w = T x', rho = r - r_0 = c_1 s + c_2 s^2 + c_3 s^3:
    e' = w, w' = T^2/m (u + K (rho - e)) + T/m (B rho' - (b + B) w).
    """
    g = len(m)
    I = np.eye(g)  # noqa: E741 (the identity's letter)
    per_mass = (T / m)[:, None]
    A = np.zeros((7, g, 7, g))  # blocks e, w, rho, rho', rho'', rho''', u
    A[0, :, 1], A[2, :, 3], A[3, :, 4], A[4, :, 5] = I, I, I, I
    A[1, :, 0], A[1, :, 2], A[1, :, 6] = -T * per_mass * K, T * per_mass * K, T * per_mass * I
    A[1, :, 1], A[1, :, 3] = -per_mass * (np.diag(b) + B), per_mass * B
    E = expm1(A.reshape(7 * g, 7 * g)).reshape(7, g, 7, g)[:2]
    # At s = 0 rho' = c_1 = h_0, rho'' = 2 c_2 = 6 D - 4 h_0 - 2 h_1, rho''' = 6 c_3 = -12 D + 6 h_0 + 6 h_1,
    # D = r_1 - r_0, h = T r' (Hermite).
    M = np.empty((2, g, 6, g))
    M[:, :, 0], M[:, :, 1], M[:, :, 2] = E[:, :, 0], T * E[:, :, 1], E[:, :, 6]
    M[:, :, 3] = 6.0 * E[:, :, 4] - 12.0 * E[:, :, 5]
    M[:, :, 4] = T * (E[:, :, 3] - 4.0 * E[:, :, 4] + 6.0 * E[:, :, 5])
    M[:, :, 5] = T * (6.0 * E[:, :, 5] - 2.0 * E[:, :, 4])
    M[1, :, 1] += T * I  # expm1 leaves the identity out: of x it is the change that is wanted
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
