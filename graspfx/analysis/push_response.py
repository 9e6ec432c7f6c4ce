"""Delay, mobility and drag of a fingertip from its response to small pushes, by least squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

GRID = 80  # number of delays of the first grid
REFINED = 40  # number of golden-section steps between two neighbours of the best delay
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
GROUPS = 10  # groups of pushes, each of which is left out once to estimate the error
SLOW = 1e-6  # p t below which drag is not noticeable


@dataclass(frozen=True, eq=False)
class Push:
    """Motion of a fingertip before and during a force along one axis.

    Attributes:
        axis: Index of the force's axis.
        force: Signed force [N].
        time: Time from the end of the writing of the force to the start of each reading, (n,) [s].
        position: Positions read, (n, d) [m].
    """

    axis: int
    force: float
    time: FloatArray
    position: FloatArray


class Estimate(NamedTuple):
    """An estimate and its standard error by the jackknife: the estimate is repeated without each group of the data."""

    value: float
    error: float


@dataclass(frozen=True, eq=False)
class Response:
    """Response of a fingertip to pushes.

    Attributes:
        delay: Time from the end of the writing of a force to the start of the first reading with a motion [s].
        mobility: Mobility W, which maps a force to an acceleration, (d, d) [1/kg].
        mass: Geometric mean of the eigenvalues of W^-1 [kg].
        explained: Share of the squared displacements that the fitted model explains, at most 1.
    """

    delay: Estimate
    mobility: FloatArray
    mass: Estimate
    explained: float


def response(pushes: Sequence[Push], drag: float, longest: float) -> Response:
    """Fit the mobility W and the delay t_0 of a fingertip to its motions under forces f.

    The model of a push is x(t) = x_0 + v_0 h(t) + W f g(t - t_0), with an initial position x_0 and velocity v_0 for
    each push. The functions h and g are the displacements of a coasting mass, h'' + p h' = 0, and of a mass under a
    unit force, g'' + p g' = 1; g is zero before t_0.

    Args:
        pushes: Pushes, at least 10 along every axis.
        drag: Drag p, friction divided by mass [1/s].
        longest: Largest delay that is considered [s].

    Raises:
        InputError: If there are fewer than 10 pushes along an axis.
    """
    d = pushes[0].position.shape[1] if pushes else 0
    counts = [sum(push.axis == axis for push in pushes) for axis in range(d)]
    if not pushes or min(counts) < GROUPS:
        raise InputError("pushes", counts, f"at least {GROUPS} pushes along each axis")
    table = _Table(pushes, drag)
    whole = np.ones(len(pushes), dtype=bool)
    delay = _least(lambda t: table.fit(t, whole)[1], longest)
    mobility, left = table.fit(delay, whole)
    explained = 1.0 - left / max(table.size, 1e-300)
    order = np.concatenate([np.arange(count) % GROUPS for count in counts])
    groups = np.empty(len(pushes), dtype=int)
    groups[np.argsort([push.axis for push in pushes], kind="stable")] = order
    delays, masses = [], []
    for group in range(GROUPS):
        selection = groups != group
        delays.append(_least(lambda t, selection=selection: table.fit(t, selection)[1], longest))  # type: ignore[misc]
        masses.append(mean_mass(table.fit(delays[-1], selection)[0]))
    mass = Estimate(mean_mass(mobility), _jackknife(masses))
    return Response(Estimate(delay, _jackknife(delays)), mobility, mass, explained)


def mean_mass(mobility: FloatArray) -> float:
    """Return the geometric mean of the inverse mobility's eigenvalues [kg]; inf if an eigenvalue is not positive."""
    d = len(mobility)
    values = np.linalg.eigvalsh(0.5 * (mobility + mobility.T))
    return float(np.prod(values) ** (-1.0 / d)) if values[0] > 0.0 else float("inf")


class _Table:
    """N pushes as arrays (N, n), from which each push's best-fitting coasting motion x_0 + v_0 h(t) is subtracted."""

    def __init__(self, pushes: Sequence[Push], drag: float) -> None:
        n = max(len(push.time) for push in pushes)
        self.drag, self.axis = drag, np.array([push.axis for push in pushes])
        self.force = np.array([push.force for push in pushes])
        self.time, self.weight = np.zeros((len(pushes), n)), np.zeros((len(pushes), n))
        position = np.zeros((len(pushes), n, pushes[0].position.shape[1]))
        for i, push in enumerate(pushes):
            count = len(push.time)
            self.time[i, :count], self.weight[i, :count] = push.time, 1.0
            position[i, :count] = push.position
        slow = drag * float(np.abs(self.time).max()) < SLOW
        self.coast = self.time if slow else -np.expm1(-drag * self.time) / drag  # path of a finger from 1 m/s
        self.position = self._free(position)
        self.size = float((self.position**2).sum())

    def _free(self, values: FloatArray) -> FloatArray:
        """Subtract the best-fitting coasting motion x_0 + v_0 h(t) of each push from values (N, n, ...)."""
        w = self.weight
        count = w.sum(axis=1)
        mean = (w * self.coast).sum(axis=1) / count
        t = w * (self.coast - mean[:, None])
        spread = (t * t).sum(axis=1)
        wide = w[..., None] * values
        level = wide.sum(axis=1) / count[:, None]
        slope = (t[..., None] * values).sum(axis=1) / spread[:, None]
        return np.asarray(wide - w[..., None] * level[:, None] - t[..., None] * slope[:, None])

    def fit(self, delay: float, selection: NDArray[np.bool_]) -> tuple[FloatArray, float]:
        """Return the best-fitting W for a delay and a mask of the pushes (N,), and the sum of squared residuals."""
        basis = self._free((self.force[:, None] * _travel(self.time - delay, self.drag))[..., None])[..., 0]
        d = self.position.shape[2]
        W, left = np.zeros((d, d)), 0.0
        for axis in range(d):
            rows = selection & (self.axis == axis)
            b, x = basis[rows], self.position[rows]
            size = float((b * b).sum())
            W[:, axis] = np.einsum("ij,ijk->k", b, x) / size if size > 0.0 else 0.0
            left += float(((x - b[..., None] * W[:, axis]) ** 2).sum())
        return W, left


def _travel(t: FloatArray, drag: float) -> FloatArray:
    """Compute g(t), the displacement of a unit mass after a unit force has acted for t; zero for negative t."""
    s = np.maximum(t, 0.0)
    if drag * float(s.max(initial=0.0)) < SLOW:
        return np.asarray(0.5 * s * s)
    return np.asarray((s + np.expm1(-drag * s) / drag) / drag)


def _least(badness: Callable[[float], float], longest: float) -> float:
    """Minimise a function of the delay on a grid up to `longest`, then by golden sections near the best grid point."""
    grid = np.linspace(-0.25 * longest, longest, GRID)
    best = int(np.argmin([badness(t) for t in grid.tolist()]))
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, GRID - 1)])
    for _ in range(REFINED):
        a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        low, high = (low, b) if badness(a) < badness(b) else (a, high)
    return 0.5 * (low + high)


def _jackknife(values: Sequence[float]) -> float:
    """Estimate the standard error of an estimate from its values without each group of the data."""
    n = len(values)
    return float(np.sqrt((n - 1) / n * ((np.array(values) - np.mean(values)) ** 2).sum()))


def drag_matrix(runs: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Fit the drag P of coasting fingertips, x'' + P x' = 0.

    The integrated equation x(t) = a + b t - P int x dt is fitted by least squares, with separate a and b for each run.

    Args:
        runs: Times (n,) [s] and positions (n, d) [m] of each run.

    Returns:
        Drag P, (d, d) [1/s], and estimates of P that each leave out one run, (runs, d, d).

    Raises:
        InputError: If there are fewer than two runs.
    """
    if len(runs) < 2:
        raise InputError("runs", len(runs), "two or more")
    left, right = [], []
    for time, position in runs:
        steps = np.diff(time)[:, None]
        area = np.vstack([np.zeros(position.shape[1]), np.cumsum(0.5 * steps * (position[1:] + position[:-1]), axis=0)])
        basis = np.linalg.qr(np.column_stack([np.ones(len(time)), time - time.mean()]))[0]
        left.append(-(area - basis @ (basis.T @ area)))
        right.append(position - basis @ (basis.T @ position))
    every = np.arange(len(runs))
    return _solved(left, right, every), np.array([_solved(left, right, every[every != k]) for k in every])


def _solved(left: Sequence[FloatArray], right: Sequence[FloatArray], rows: NDArray[np.intp]) -> FloatArray:
    A, b = np.vstack([left[k] for k in rows]), np.vstack([right[k] for k in rows])
    return np.asarray(np.linalg.lstsq(A, b, rcond=1e-6)[0].T)


def mean_friction(mobility: FloatArray, drag: FloatArray) -> float:
    """Return the geometric mean of the eigenvalues of the friction W^-1 P, for mobility W and drag P [N s/m].

    Only the symmetric part of the friction is used, and negative eigenvalues count as zero.
    """
    B = np.linalg.solve(mobility, drag)
    values = np.maximum(np.linalg.eigvalsh(0.5 * (B + B.T)), 0.0)
    return float(np.prod(values) ** (1.0 / len(values)))


def friction_of(mobility: FloatArray, drag: FloatArray, others: FloatArray) -> Estimate:
    """Return the mean friction and its standard error, from the two results of `drag_matrix`."""
    values = [mean_friction(mobility, each) for each in others]
    return Estimate(mean_friction(mobility, drag), _jackknife(values))
