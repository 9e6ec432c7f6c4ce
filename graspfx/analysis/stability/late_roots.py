"""Eigenvalues of loops with long delays, without a state for each delayed sample.

A loop with states s_k and reactions h_k, of which reaction i has a delay of n_i samples, is s_(k+1) = A s_k + B h_k
with h_k,i = -(C s_(k - n_i))_i. Its eigenvalues are the z with det T(z) = 0, where

    T(z) = z I + B diag(z^-n) C - A

The number of eigenvalues is the number of states plus the number of delayed samples. The function det(T(z)/z) tends to
1 for large z and has no poles except at z = 0. By the argument principle, the number of eigenvalues with |z| > rho is
the number of times that this function winds clockwise around zero while z moves along the circle |z| = rho. The
function is computed from the Schur form A = U S U^H, whose diagonal entries are l_i:

    det(T(z)/z) = prod_i (1 - l_i/z) det(I + diag(z^-n) H(z)),  H(z) = C U (z I - S)^-1 U^H B.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

EVEN = 160  # number of evenly spaced initial points on the half circle
NEAR = np.concatenate([-np.geomspace(0.1, 1e3, 9)[::-1], [0.0], np.geomspace(0.1, 1e3, 9)])  # about eigenvalues of A
TURN = 0.7  # largest change of the determinant's phase [rad], and of its logarithm, between points
UNEVEN = 4.0  # largest ratio of neighbouring steps
PER_TURN = 9.0  # points per turn of z^-n where the reaction matters
COUNTS = 0.2  # gain of the reaction above which the reaction matters
ROUNDS = 40  # largest number of bisections
FINEST = 1e-13  # smallest step [rad]
TRIES = 4  # number of searches, from circles of several radii, before counting alone decides
LEAST, NARROW = 1e-3, 1e-11  # smallest |z| that is searched; relative width of the bracket by counting
MOST_GROWTH = 1e200  # largest z^-n that is searched
STEPS = 60  # largest number of iterations
SAME, SOUND = 1e-13, 1e-9  # relative to |z|: steps that are rounding; largest last step of an accepted eigenvalue
LONGEST = 0.05  # largest step
STARTS = 24  # number of starts of each kind: the smallest determinants, and the largest eigenvalues of A
ROUNDING = 1e-15
AT_ONCE = 1_000_000  # entries of (z I - S)^-1 U^H B that are computed together for several points
OUTSIDE = 1e-9  # relative distance from the farthest root outwards, beyond which no root may exist


@dataclass(frozen=True, eq=False)
class LateLoop:
    """Loop of N states with p delayed reactions: A (N, N), B (N, p), C (p, N), and delays n (p,) [samples]."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    delay: NDArray[np.int64]

    def matrices(self, z: ComplexArray) -> ComplexArray:
        """Compute T(z) at each z (points,), (points, N, N)."""
        late = z[:, None] ** -self.delay[None, :].astype(float)
        T = (self.B[None] * late[:, None, :]) @ self.C[None].astype(complex) - self.A[None]
        i = np.arange(len(self.A))
        T[:, i, i] += z[:, None]
        return np.asarray(T)

    def slopes(self, z: ComplexArray) -> ComplexArray:
        """Compute the derivative of T(z) at each z (points,), (points, N, N)."""
        n = self.delay[None, :].astype(float)
        late = -n * z[:, None] ** (-n - 1.0)
        S = (self.B[None] * late[:, None, :]) @ self.C[None].astype(complex)
        i = np.arange(len(self.A))
        S[:, i, i] += 1.0
        return np.asarray(S)

    @cached_property
    def eigenvalues(self) -> ComplexArray:
        """Eigenvalues l_i of A, (N,)."""
        return np.asarray(np.diag(self._schur[0]))

    @cached_property
    def _schur(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Matrices S, U^H B and C U, with the Schur form A = U S U^H."""
        from scipy.linalg import schur

        S, U = schur(self.A, output="complex")
        return S, U.conj().T @ self.B, self.C @ U

    def responses(self, z: ComplexArray) -> ComplexArray:
        """Compute H(z) at each z (points,), (points, p, p)."""
        n, p = self.B.shape
        return np.concatenate([self._responses(part) for part in np.array_split(z, 1 + len(z) * n * p // AT_ONCE)])

    def _responses(self, z: ComplexArray) -> ComplexArray:
        S, B, C = self._schur
        n, p = B.shape
        gaps = self._gaps(z)
        Y = np.empty((n, len(z), p), dtype=complex)
        for i in reversed(range(n)):
            below = (S[i, i + 1 :] @ Y[i + 1 :].reshape(n - i - 1, len(z) * p)).reshape(len(z), p)
            Y[i] = (B[i] + below) / gaps[:, i, None]
        return np.asarray((C @ Y.reshape(n, -1)).reshape(p, len(z), p).transpose(1, 0, 2))

    def _gaps(self, z: ComplexArray) -> ComplexArray:
        """Compute z - l_i at each z, (points, N); values of magnitude up to 1e-15 are replaced by 1e-15."""
        gaps = z[:, None] - self.eigenvalues
        return np.where(np.abs(gaps) > ROUNDING, gaps, ROUNDING)

    def determinants(self, z: ComplexArray, H: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Compute the phase of det(T(z)/z) and the logarithm of its magnitude at each z, from H(z)."""
        factors = self._gaps(z) / z[:, None]
        late = z[:, None] ** -self.delay[None, :].astype(float)
        sign, size = np.linalg.slogdet(np.eye(len(self.delay)) + late[:, :, None] * H)
        return np.angle(sign) + np.angle(factors).sum(axis=1), size + np.log(np.abs(factors)).sum(axis=1)


def roots_beyond(loop: LateLoop, radius: float) -> int:
    """Count the eigenvalues z of a loop with |z| > radius."""
    count, _, _ = _walk(loop, radius)
    return count


def root_at(loop: LateLoop, radius: float) -> complex | None:
    """Find an eigenvalue near the circle |z| = radius; return None if the iteration does not converge.

    The iteration starts from the point of the circle at which the phase of det(T(z)/z) changes fastest.
    """
    angle, phase, _ = _points(loop, radius)
    k = int((_turns(phase) / np.diff(angle)).argmax())
    return root_near(loop, complex(radius * np.exp(0.5j * (angle[k] + angle[k + 1]))))


def farthest_root(loop: LateLoop) -> complex:
    """Find an eigenvalue z of a loop with the largest |z|."""
    radius, best = 1.0, 0j
    for _ in range(TRIES):
        count, angles, size = _walk(loop, radius)
        best = _farthest(loop, radius, angles, size, best)
        if count == 0 and abs(best) > 0.0:
            if _walk(loop, abs(best) * (1.0 + OUTSIDE))[0] == 0:
                return best
            radius = math.sqrt(radius * abs(best))  # another root lies between
        elif abs(best) > radius:
            if _walk(loop, abs(best) * (1.0 + OUTSIDE))[0] == 0:
                return best
            radius = abs(best) * (1.0 + 1e-4)
        else:
            radius *= 0.9 if count == 0 else 1.01
    return _bisected(loop)


def _bisected(loop: LateLoop) -> complex:
    """Find an eigenvalue of largest |z| by bisecting the radius with root counts.

    This is used where iterations fail, because they converge slowly to multiple eigenvalues.
    """
    low = high = 1.0
    least = max(LEAST, MOST_GROWTH ** (-1.0 / float(loop.delay.max())))
    while low > least and not _walk(loop, low)[0]:
        low, high = 0.9 * low, low
    if low == high:
        while _walk(loop, high)[0]:
            low, high = high, 1.05 * high
    while high - low > NARROW * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _walk(loop, middle)[0] else (low, middle)
    _, angle, size = _walk(loop, high)
    return complex(high * np.exp(1j * float(angle[size.argmin()])))


def _walk(loop: LateLoop, radius: float) -> tuple[int, FloatArray, FloatArray]:
    """Count the eigenvalues with |z| > radius; also return angles and log |det(T(z)/z)| of points on |z| = radius."""
    angle, phase, size = _points(loop, radius)
    turns = np.angle(np.exp(1j * np.diff(phase))).sum() / math.pi  # both halves of the circle
    return round(-float(turns)), angle, size


def _points(loop: LateLoop, radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose points on |z| = radius so dense that det(T(z)/z) changes little between neighbours.

    The result is the angles of the points, from 0 to pi, and the phase and log magnitude of det(T(z)/z) at the points.
    """
    angle, phase, size = _start(loop, radius)
    for _ in range(ROUNDS):
        wide = (_turns(phase) > TURN) | (np.abs(np.diff(size)) > TURN) | _is_uneven(angle)
        wide &= np.diff(angle) > FINEST
        if not wide.any():
            break
        places = np.flatnonzero(wide)
        middle = 0.5 * (angle[places] + angle[places + 1])
        z = _circle(radius, middle)
        more, sizes = loop.determinants(z, loop.responses(z))
        angle = np.insert(angle, places + 1, middle)
        phase, size = np.insert(phase, places + 1, more), np.insert(size, places + 1, sizes)
    return angle, phase, size


def _turns(phase: FloatArray) -> FloatArray:
    return np.asarray(np.abs(np.angle(np.exp(1j * np.diff(phase)))))


def _start(loop: LateLoop, radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose initial points on |z| = radius; the result is that of `_points`.

    The points are evenly spaced, clustered near angle zero and near eigenvalues of A, and dense where H(z) is not
    small.
    """
    z = loop.eigenvalues
    z = z[(z.imag >= 0.0) & (np.abs(z) > 0.3 * radius)]
    about = (np.angle(z)[:, None] + np.maximum(np.abs(np.abs(z) / radius - 1.0), 1e-9)[:, None] * NEAR).ravel()
    low = np.geomspace(1e-7, 0.1, 40)
    angle = _even(np.concatenate([np.linspace(0.0, math.pi, EVEN), about, low]).clip(0.0, math.pi))
    points = _circle(radius, angle)
    H = loop.responses(points)
    phase, size = loop.determinants(points, H)
    gain = np.linalg.norm(H, axis=(1, 2)) * radius ** -float(loop.delay.min())
    step = 2.0 * math.pi / (PER_TURN * float(loop.delay.max()) * max(1, loop.B.shape[1]))
    counts = np.maximum(gain[1:], gain[:-1]) > COUNTS
    parts = np.where(counts, np.ceil(np.diff(angle) / step), 1.0).astype(int)
    place = np.repeat(np.arange(len(parts)), parts - 1)
    share = np.concatenate([np.arange(1, k) / k for k in parts[parts > 1]] or [np.empty(0)])
    middle = np.setdiff1d(_even(np.append(angle, angle[place] + share * (angle[place + 1] - angle[place]))), angle)
    z = _circle(radius, middle)
    more, sizes = loop.determinants(z, loop.responses(z))
    place = np.searchsorted(angle, middle)
    return np.insert(angle, place, middle), np.insert(phase, place, more), np.insert(size, place, sizes)


def _even(angle: FloatArray) -> FloatArray:
    """Sort angles, and halve steps that are much wider than their neighbours."""
    angle = np.unique(angle)
    while (wide := _is_uneven(angle)).any():
        place = np.flatnonzero(wide)
        angle = np.insert(angle, place + 1, 0.5 * (angle[place] + angle[place + 1]))
    return angle


def _is_uneven(angle: FloatArray) -> NDArray[np.bool_]:
    """Return a mask of the steps between angles that are much wider than a neighbouring step.

    Such a step may pass a multiple root, near which a change of the phase by 2 pi cannot be seen at the step's ends.
    """
    step = np.diff(angle)
    beside = np.minimum(np.append(step[1:], np.inf), np.insert(step[:-1], 0, np.inf))
    return np.asarray(step > UNEVEN * np.maximum(beside, FINEST))


def _circle(radius: float, angle: FloatArray) -> ComplexArray:
    return np.asarray(radius * np.exp(1j * angle))


def _farthest(loop: LateLoop, radius: float, angle: FloatArray, size: FloatArray, best: complex) -> complex:
    """Return the one of largest |z| among `best` and the eigenvalues to which Newton's method converges.

    The starts are points on |z| = radius where |det(T(z)/z)| has a local minimum, and eigenvalues of A.
    """
    dips = np.flatnonzero((size <= np.append(size[1:], np.inf)) & (size <= np.insert(size[:-1], 0, np.inf)))
    dips = dips[np.argsort(size[dips])][:STARTS]
    alone = loop.eigenvalues
    alone = alone[(alone.imag >= 0.0)]
    alone = alone[np.argsort(-np.abs(alone))][:STARTS]
    z = np.concatenate([_circle(radius, angle[dips]), alone * (1.0 + 1e-7j)])
    return max([best, *_roots_near(loop, z[np.abs(z) > 0.3 * radius])], key=abs)


def root_near(loop: LateLoop, z: complex) -> complex | None:
    """Find an eigenvalue from the start z by successive linear problems T(z) x = m T'(z) x, where -m is the step of z.

    The method converges to eigenvalues that are multiple by symmetry as fast as to simple eigenvalues. Return None if
    it does not converge.
    """
    at = np.array([z], dtype=complex)
    for _ in range(STEPS):
        try:
            steps = np.linalg.eigvals(np.linalg.solve(loop.matrices(at), loop.slopes(at)))[0]
        except np.linalg.LinAlgError:
            return complex(at[0])  # T is singular there
        step = complex(1.0 / steps[np.abs(steps).argmax()])
        at = at - step * min(1.0, LONGEST / abs(step))
        if abs(step) <= SAME * abs(at[0]):
            return complex(at[0])
    return complex(at[0]) if abs(step) <= SOUND * abs(at[0]) else None


def _roots_near(loop: LateLoop, starts: ComplexArray) -> list[complex]:
    """Apply Newton's method to det T(z) from each start; return the eigenvalues to which it converges.

    The step of the method is -1/trace(T^-1 T').
    """
    z = starts.astype(complex)
    change = np.full(len(z), np.inf)
    for _ in range(STEPS):
        moving = np.flatnonzero(np.abs(change) > SAME * np.abs(z))
        if not len(moving):
            break
        with np.errstate(all="ignore"):
            try:
                quotient = np.linalg.solve(loop.matrices(z[moving]), loop.slopes(z[moving]))
            except np.linalg.LinAlgError:
                z[moving] *= 1.0 + 1e-14
                continue
            step = 1.0 / np.trace(quotient, axis1=1, axis2=2)
        step *= np.minimum(1.0, LONGEST / np.maximum(np.abs(step), LONGEST))
        sound = np.isfinite(step)
        z[moving[sound]] -= step[sound]
        change[moving] = np.where(sound, np.abs(step), np.nan)
    return [complex(each) for each in z[np.abs(change) <= SOUND * np.abs(z)]]
