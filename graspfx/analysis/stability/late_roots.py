"""Eigenvalues of loops with long delays, without a state for each sample of them.

A loop s_(k+1) = A s_k + B h_k, h_k,i = -(C s_(k - n_i))_i has the eigenvalues z with det T(z) = 0,

    T(z) = z I + B diag(z^-n) C - A,

as many as states and samples of delay together. How many of them lie beyond a circle |z| = rho is the number of times
that det(T(z)/z), which is 1 far out and has no poles there, goes round zero on it, clockwise: the argument principle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

EVEN = 160  # points of the half circle to begin with
NEAR = np.concatenate([-np.geomspace(0.1, 1e3, 9)[::-1], [0.0], np.geomspace(0.1, 1e3, 9)])  # about eigenvalues of A
TURN = 0.7  # [rad]: the most that the determinant may turn from a point to the next, and its logarithm change
PER_TURN = 9.0  # points of a turn of z^-n where the reaction counts
COUNTS = 0.2  # of 1: a gain of the reaction that turns the determinant
ROUNDS = 40  # of halvings
FINEST = 1e-13  # [rad]
TRIES = 4  # of Newton's method, from circles of several radii, before counting alone decides
LEAST, NARROW = 1e-3, 1e-11  # |z| below which nothing is looked for; relative width of what counting leaves
STEPS = 60  # of Newton's method
SAME = 1e-13  # relative: steps that are rounding
STARTS = 24  # of Newton's method, the likeliest ones
OUTSIDE = 1e-9  # beyond the farthest root, where none may be


@dataclass(frozen=True, eq=False)
class LateLoop:
    """A (N, N), B (N, p), C (p, N) and delays n (p,) [samples] of a loop with a late reaction."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    delay: NDArray[np.int64]

    def matrices(self, z: ComplexArray) -> ComplexArray:
        """Compute T of each z, (points, N, N)."""
        late = z[:, None] ** -self.delay[None, :].astype(float)
        T = (self.B[None] * late[:, None, :]) @ self.C[None].astype(complex) - self.A[None]
        i = np.arange(len(self.A))
        T[:, i, i] += z[:, None]
        return np.asarray(T)

    def slopes(self, z: ComplexArray) -> ComplexArray:
        """Compute dT/dz of each z, (points, N, N)."""
        n = self.delay[None, :].astype(float)
        late = -n * z[:, None] ** (-n - 1.0)
        S = (self.B[None] * late[:, None, :]) @ self.C[None].astype(complex)
        i = np.arange(len(self.A))
        S[:, i, i] += 1.0
        return np.asarray(S)


def roots_beyond(loop: LateLoop, radius: float) -> int:
    """Count the eigenvalues with |z| > radius."""
    count, _, _ = _walk(loop, radius)
    return count


def farthest_root(loop: LateLoop) -> complex:
    """Find an eigenvalue of largest |z|."""
    radius, best = 1.0, 0j
    for _ in range(TRIES):
        count, angles, size = _walk(loop, radius)
        best = _farthest(loop, radius, angles, size, best)
        if count == 0 and abs(best) > 0.0:
            if _walk(loop, abs(best) * (1.0 + OUTSIDE))[0] == 0:
                return best
            radius = math.sqrt(radius * abs(best))  # something is between
        elif abs(best) > radius:
            if _walk(loop, abs(best) * (1.0 + OUTSIDE))[0] == 0:
                return best
            radius = abs(best) * (1.0 + 1e-4)
        else:
            radius *= 0.9 if count == 0 else 1.01
    return _bisected(loop)


def _bisected(loop: LateLoop) -> complex:
    """Find the largest |z| by counting alone: where eigenvalues are many times the same, Newton's method is slow."""
    low = high = 1.0
    while low > LEAST and not _walk(loop, low)[0]:
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
    """Walk along half a circle: roots beyond it, the angles, and log |det T/z| there."""
    angle = _angles(loop, radius)
    phase, size = _determinant(loop, radius, angle)
    for _ in range(ROUNDS):
        turn = np.abs(np.angle(np.exp(1j * np.diff(phase))))
        wide = ((turn > TURN) | (np.abs(np.diff(size)) > TURN)) & (np.diff(angle) > FINEST)
        if not wide.any():
            break
        places = np.flatnonzero(wide)
        middle = 0.5 * (angle[places] + angle[places + 1])
        more, sizes = _determinant(loop, radius, middle)
        angle = np.insert(angle, places + 1, middle)
        phase, size = np.insert(phase, places + 1, more), np.insert(size, places + 1, sizes)
    turns = np.angle(np.exp(1j * np.diff(phase))).sum() / math.pi  # both halves of the circle
    return round(-float(turns)), angle, size


def _angles(loop: LateLoop, radius: float) -> FloatArray:
    """Choose angles to begin with: even ones, some about eigenvalues of A, fine ones where the reaction counts."""
    z = np.linalg.eigvals(loop.A)
    z = z[(z.imag >= 0.0) & (np.abs(z) > 0.3 * radius)]
    about = (np.angle(z)[:, None] + np.maximum(np.abs(np.abs(z) / radius - 1.0), 1e-9)[:, None] * NEAR).ravel()
    low = np.geomspace(1e-7, 0.1, 40)
    angle = np.unique(np.concatenate([np.linspace(0.0, math.pi, EVEN), about, low]).clip(0.0, math.pi))
    points = radius * np.exp(1j * angle)
    plain = points[:, None, None] * np.eye(len(loop.A)) - loop.A
    try:
        response = loop.C @ np.linalg.solve(plain, np.broadcast_to(loop.B, (len(angle), *loop.B.shape)).astype(complex))
    except np.linalg.LinAlgError:
        gain = np.full(len(angle), np.inf)
    else:
        gain = np.linalg.norm(response, axis=(1, 2)) * radius ** -float(loop.delay.min())
    step = 2.0 * math.pi / (PER_TURN * float(loop.delay.max()) * max(1, loop.B.shape[1]))
    counts = np.maximum(gain[1:], gain[:-1]) > COUNTS
    parts = np.where(counts, np.ceil(np.diff(angle) / step), 1.0).astype(int)
    fine = [np.linspace(a, b, k, endpoint=False) for a, b, k in zip(angle[:-1], angle[1:], parts, strict=True)]
    return np.concatenate([*fine, angle[-1:]])


def _determinant(loop: LateLoop, radius: float, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute phase and log of the size of det(T/z)."""
    z = radius * np.exp(1j * angle)
    sign, size = np.linalg.slogdet(loop.matrices(z))
    n = len(loop.A)
    return np.angle(sign) - n * angle, size - n * math.log(radius)


def _farthest(loop: LateLoop, radius: float, angle: FloatArray, size: FloatArray, best: complex) -> complex:
    """Follow Newton's method from where the determinant is small, and from eigenvalues of A; the farthest root."""
    dips = np.flatnonzero((size <= np.append(size[1:], np.inf)) & (size <= np.insert(size[:-1], 0, np.inf)))
    dips = dips[np.argsort(size[dips])][:STARTS]
    alone = np.linalg.eigvals(loop.A)
    alone = alone[(alone.imag >= 0.0)]
    alone = alone[np.argsort(-np.abs(alone))][:STARTS]
    z = np.concatenate([radius * np.exp(1j * angle[dips]), alone * (1.0 + 1e-7j)])
    z = z[np.abs(z) > 0.3 * radius].astype(complex)
    done = np.zeros(len(z), dtype=bool)
    for _ in range(STEPS):
        with np.errstate(all="ignore"):
            try:
                slope = np.trace(np.linalg.solve(loop.matrices(z), loop.slopes(z)), axis1=1, axis2=2)
            except np.linalg.LinAlgError:
                z = z * (1.0 + 1e-14)
                continue
            change = 1.0 / slope
        change = np.where(np.isfinite(change), change, 0.0)
        long = np.abs(change) > 0.05
        change[long] *= 0.05 / np.abs(change[long])
        z = z - change
        done = np.abs(change) <= SAME * np.abs(z)
        if done.all():
            break
    sound = [complex(each) for each in z[np.abs(change) <= 1e-9 * np.abs(z)]]
    return max([best, *sound], key=abs)
