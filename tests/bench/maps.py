"""Maps of stability limits and whole certificates, beside eigenvalues with root finding and python-control."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

import graspfx as gx
from graspfx.bench.timing import Case, Method
from tests.bench.peers import imported

FloatArray = NDArray[np.float64]
Plant = tuple[float, float, float]  # m, b and k of m x'' + b x' + k x = u

TITLE = "Limits of stability: maps and certificates"
LIMITS = """
Times are per point of a map, from a call of `external_limit_map` or `wall_limit_map`. The peers have no closed form:
they sample the plants and search for the gain at which the largest eigenvalue of the loop meets the unit circle, or its
Nyquist curve the point -1; python-control finds all margins of any loop, and one of them is used. The peers are timed
on a few of the points. Errors are at these points, all with friction, without delay, against 30 digits. Certificates
are whole calls of `gx.certify`, with every limit. Their error is the deviation from 1 of the spectral radius of the
loop, linearised again at the limit of the external gain.
"""

T, SPRING, FRICTION, OBJECT = 0.005, 33.0, 0.2, 0.1
COMPARED = 8  # points that the oracle and the peers are asked for
WRONG = 1e-3
SCENES = ("reference-1dof", "paper-spring")
DIGITS = 30


def cases(quick: bool) -> Iterator[Case]:
    """Yield maps of two kinds, then certificates."""
    side = 60 if quick else 200
    mass, viscosity = np.linspace(0.05, 0.2, side)[:, None], np.linspace(0.2, 2.0, side)
    rows, columns = np.random.default_rng(3).integers(0, side, (2, COMPARED))
    points = [(float(mass[i, 0]), float(viscosity[j])) for i, j in zip(rows, columns, strict=True)]

    def external() -> FloatArray:
        return gx.stability.external_limit_map(mass, FRICTION, T, OBJECT, viscosity, spring=SPRING)

    def wall() -> FloatArray:
        return gx.stability.wall_limit_map(mass, viscosity, T, spring=SPRING)

    # two fingers: each device has half of the object
    moving = [[(m, FRICTION, SPRING), (OBJECT / 2, b / 2, 0.0)] for m, b in points]
    walls = [[(m, b, SPRING)] for m, b in points]
    for name, limits, loops in (("device that moves an object", external, moving), ("device on a wall", wall, walls)):
        exact = np.array(
            [crossing(plants, T, k) for plants, k in zip(loops, limits()[rows, columns].tolist(), strict=True)]
        )

        def ours(limits: Callable[[], FloatArray] = limits) -> FloatArray:
            return limits()[rows, columns]

        methods = [Method("GraspFX", limits, partial(_error, ours, exact), calls=side * side)]
        for peer, limit in PEERS.items():
            solve = partial(_limits, limit, loops)
            methods.append(Method(peer, solve, partial(_error, solve, exact), calls=COMPARED))
        yield Case("maps", f"{name}, {side} by {side}", "relative", methods, WRONG)
    for scene in SCENES:
        own = gx.load(scene)
        methods = [
            Method(f"GraspFX certify{'(quick=True)' if brief else '()'}", partial(gx.certify, own, quick=brief),
                   partial(certificate_error, own, brief)) for brief in (False, True)
        ]  # fmt: skip
        yield Case("maps", f"whole certificate, {scene}", "of the radius", methods, WRONG)


def certificate_error(scene: gx.Scene, quick: bool) -> float:
    """Compare the spectral radius at the limit of the external gain with 1."""
    row = next(row for row in gx.certify(scene, quick=quick)[0].limits if row.mode == "external")
    return abs(gx.stability.spectral_radius(scene.replace({"coupling.external.stiffness": row.limit})) - 1.0)


def _limits(limit: Callable[[Sequence[Plant], float], float], loops: Sequence[Sequence[Plant]]) -> FloatArray:
    return np.array([limit(plants, T) for plants in loops])


def _error(limits: Callable[[], FloatArray], exact: FloatArray) -> float:
    return float(np.abs(limits() / exact - 1.0).max())


def by_eigenvalues(plants: Sequence[Plant], period: float) -> float:
    """Find the k at which the largest eigenvalue of A - k B C is on the unit circle, by doubling and Brent's method."""
    size = 2 * len(plants)
    A, B, C = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for i, (m, b, k) in enumerate(plants):  # the force moves the first forward, the second back
        whole = expm(np.array([[0.0, 1.0, 0.0], [-k / m, -b / m, 1.0 / m], [0.0, 0.0, 0.0]]) * period)
        own, sign = slice(2 * i, 2 * i + 2), -1.0 if i else 1.0
        A[own, own], B[own], C[2 * i] = whole[:2, :2], sign * whole[:2, 2], sign
    feedback = np.outer(B, C)

    def excess(k: float) -> float:
        return float(np.abs(np.linalg.eigvals(A - k * feedback)).max()) - 1.0

    stable, other = 1.0, 2.0
    while excess(other) < 0.0:
        stable, other = other, 2.0 * other
    return float(brentq(excess, stable, other, xtol=1e-12, rtol=1e-14))


def by_control(plants: Sequence[Plant], period: float, method: str) -> float:
    """Ask python-control for the gain margin of the sampled plants.

    Its method "poly" finds crossings as roots of polynomials, quickly, and takes one that only touches the axis for
    one too; "best", its default, sees that coming and interpolates along the frequencies instead.
    """
    control = imported("control", "the peer of python-control")
    sampled = [control.sample_system(control.tf([1.0], [m, b, k]), period, "zoh") for m, b, k in plants]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it interpolates, for each
        return float(control.stability_margins(sum(sampled[1:], sampled[0]), method=method)[0])


PEERS: dict[str, Callable[[Sequence[Plant], float], float]] = {
    "numpy eigenvalues, Brent": by_eigenvalues,
    "python-control, margins": partial(by_control, method="best"),
    "python-control, margins by polynomials": partial(by_control, method="poly"),
}


def crossing(plants: Sequence[Plant], period: float, near: float) -> float:
    """Find the k near a given one at which f = k (x_1 - x_2), or k x_1 of one plant, is on the circle, to 30 digits."""
    mp = imported("mpmath", "the oracle of 30 digits")
    with mp.workdps(DIGITS):
        sampled = []
        for numbers in plants:
            m, b, k_s = (mp.mpf(v) for v in numbers)
            whole = mp.expm(mp.matrix([[0, 1, 0], [-k_s / m, -b / m, 1 / m], [0, 0, 0]]) * mp.mpf(period))
            sampled.append((whole[:2, :2], whole[:2, 2]))

        def excess(k: Any) -> Any:
            A = mp.zeros(2 * len(sampled))
            for i, (F, B) in enumerate(sampled):
                for r in range(2):
                    for c in range(2):
                        A[2 * i + r, 2 * i + c] += F[r, c]
                    for j in range(len(sampled)):
                        A[2 * i + r, 2 * j] += B[r] * (k if i != j else -k)
            return max(abs(z) for z in mp.eig(A, left=False, right=False)) - 1

        return float(mp.findroot(excess, (mp.mpf(near), mp.mpf(near) * (1 + mp.mpf(10) ** -6)), solver="secant"))
