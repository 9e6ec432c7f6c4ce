"""The worst frequency of a display without a grid: unit-circle eigenvalues of the positive-real pencil."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.passivity.display import StateSpace
from graspfx.analysis.passivity.frequency import polished

FloatArray = NDArray[np.float64]

ROUNDS = 60
STEP = 1e-10  # relative: how far above a value known to be reached the next level is tried
NEAR = 1e-4  # eigenvalues so near the unit circle are looked at; one too many costs an evaluation and no more


class PositiveReal:
    """W(z) = B/T + H(z)/(z - 1) with its pole taken out: T Herm W = B - T/2 H(1) + T Herm X(z), symmetric H(1).

    X(z) = (H(z) - H(1))/(z - 1) = -C (I - A)^-1 (z I - A)^-1 B, and Herm{1/(z - 1)} = -1/2 on the circle. A display is
    passive on a device with damping B iff this is nowhere negative, z = 1 included, and H(1) >= 0 (discrete positive
    real lemma, Hitz and Anderson 1969). For a stable H whose H(1) is symmetric.
    """

    def __init__(self, system: StateSpace, B: FloatArray, T: float) -> None:
        K = system.static()
        self.rest = B - T / 4 * (K + K.T)
        self.A, self.B = system.A, system.B
        self.C = -T * np.linalg.solve((np.eye(system.states) - system.A).T, system.C.T).T
        sizes = np.linalg.norm(self.B), np.linalg.norm(self.C)
        if min(sizes) > 0.0:  # states in units that make the pencil's blocks alike
            ratio = np.sqrt(sizes[1] / sizes[0])
            self.B, self.C = self.B * ratio, self.C / ratio

    def lack(self, angles: FloatArray) -> FloatArray:
        """Compute the damping that is missing at angles (k,): largest eigenvalue of -T Herm W(e^{j th}) [N s/m]."""
        z = np.exp(1j * angles)[:, None, None]
        X = self.C @ np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B + 0j)
        return np.asarray(np.linalg.eigvalsh(-self.rest - (X + X.conj().transpose(0, 2, 1)) / 2)[:, -1])

    def crossings(self, level: float, near: float = NEAR) -> FloatArray:
        """Find the angles in [0, pi] at which some eigenvalue of -T Herm W equals `level`, sorted.

        On the unit circle: z x = A x + B u, p = z (A'p + C'u), 0 = C x + B'p + 2 (rest + level) u, a symplectic pencil
        whose eigenvalues there are these angles.
        """
        from scipy.linalg import eig

        s, n = self.B.shape
        M, N = np.zeros((2, 2 * s + n, 2 * s + n))
        M[:s, :s], M[:s, 2 * s :] = self.A, self.B
        M[s : 2 * s, s : 2 * s] = np.eye(s)
        M[2 * s :, :s], M[2 * s :, s : 2 * s] = self.C, self.B.T
        M[2 * s :, 2 * s :] = 2 * (self.rest + level * np.eye(n))
        N[:s, :s] = np.eye(s)
        N[s : 2 * s, s : 2 * s], N[s : 2 * s, 2 * s :] = self.A.T, self.C.T
        over, under = eig(M, N, right=False, homogeneous_eigvals=True)
        on = (np.abs(np.abs(over) - np.abs(under)) < near * np.abs(under)) & (np.abs(under) > 0.0)
        return np.sort(np.abs(np.angle(over[on] / under[on])))

    def worst(self) -> tuple[float, float]:
        """Maximise `lack` [N s/m] over th, and give th: no level above it is crossed.

        Each round takes the crossings of the largest value so far, between which the values above it lie, and looks at
        the middles of those intervals: it converges quadratically (Boyd and Balakrishnan 1990; Bruinsma and Steinbuch
        1990, for the H-infinity norm).
        """
        start = np.concatenate([[0.0, np.pi], np.abs(np.angle(np.linalg.eigvals(self.A)))])
        values = self.lack(start)
        k = int(values.argmax())
        best, at = float(values[k]), float(start[k])
        if not len(self.A):
            return best, np.pi  # without memory every frequency is the worst
        scale = float(np.abs(values).max() + np.abs(self.rest).max())
        for _ in range(ROUNDS):
            edges = self.crossings(best + STEP * scale)
            if not len(edges):
                break
            edges = np.concatenate([[0.0], edges, [np.pi]])
            angles = np.concatenate([edges, (edges[1:] + edges[:-1]) / 2])
            values = self.lack(angles)
            k = int(values.argmax())
            if values[k] <= best + STEP * scale:
                break
            best, at = float(values[k]), float(angles[k])
        return polished(self.lack, best, at)

    def holds(self) -> bool:
        """Tell whether Herm W > 0 on the whole circle, from the pencil's eigenvalues and one evaluation alone."""
        return bool(self.lack(np.array([np.pi]))[0] < 0.0) and not len(self.crossings(0.0, near=1e-9))
