"""Least coefficient of friction for force closure, or for a wrench with bounded normal forces."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.matrix import GraspMatrix
from graspfx.grasp.quality.closure import force_closure
from graspfx.numeric import finite, number

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-10  # error of the coefficient, relative or absolute
SLACK = 1e-10  # fraction of the largest normal force that counts as zero
RANK = 1e-9  # relative, of G
LEAST = 1e-7  # smaller coefficients count as zero, because such tangential forces are below rounding
LARGEST = 1e6  # larger coefficients count as infinite
GROWTH = 20.0  # factor on the barrier's weight between centres
STEPS = 60  # largest number of Newton steps per centre


def least_friction(grasp: GraspMatrix, wrench: ArrayLike | None = None, *, normal_force: float | None = None) -> float:
    """Find the least coefficient of friction mu for which a grasp has force closure, or for which it exerts a wrench.

    Without a wrench, the result is the infimum of the coefficients for which `Grasp.force_closure` holds. With a wrench
    w, the result is the least coefficient for which contact forces f in the cones |f_t| <= mu f_n, with f_n <= L,
    satisfy G f = w. The bound L is required, because a larger squeeze needs a smaller coefficient: between opposed
    contacts, the coefficient goes to zero as L grows. mu f_n is bilinear in mu and f, so mu is found by bisection. Each
    step minimises s, subject to |f_t|/mu <= f_n + s and f_n <= L + s at each contact, by a barrier method in the
    internal forces.

    Args:
        grasp: Grasp of hard contacts with normals.
        wrench: Wrench w of the fingers on the object, (w,), about the grasp's origin [N, N m]. To balance a weight W, w
            is -W.
        normal_force: Bound L of the normal forces [N], required with a wrench; None without one.

    Returns:
        Coefficient, with an error of 1e-9 relative to the coefficient or to 1, whichever is larger; zero below 1e-7,
        infinite if no coefficient suffices.

    Raises:
        InputError: If contacts are not hard or have no normals, if the wrench has the wrong size, or if a wrench is
            given without a bound.
    """
    if not isinstance(grasp, GraspMatrix):
        raise InputError("grasp", grasp, "a Grasp", "a matrix has no information about contacts")
    grasp.require_one("least_friction")
    if any(model != "hard" for model in grasp.contacts.models):
        raise InputError("model", list(grasp.contacts.models), "hard contacts, which have one coefficient")
    if grasp.contacts.normals is None:
        raise InputError("normals", None, "a normal into the object for each contact")
    G = GraspMatrix(grasp.points, origin=grasp.origin, free=grasp.free).matrix
    moments = grasp.moment_rows
    size = np.linalg.norm(grasp.points - grasp.points.mean(axis=0), axis=1).max() or 1.0
    G = np.where(moments[:, None], G / size, G)
    if wrench is None:
        if normal_force is not None:
            raise InputError("normal_force", normal_force, "None without a wrench")
        if np.linalg.matrix_rank(G, tol=RANK * np.linalg.norm(G, 2)) < len(G):
            return math.inf
        if force_closure(grasp, 0.0):
            return 0.0
        pushes = _Pushes(grasp.contacts.normals, G, np.zeros(len(G)))
        return _bisected(lambda mu: pushes.has_slack(mu, -SLACK))
    w = finite("wrench", wrench)
    if w.shape != (len(G),):
        raise InputError("wrench", w, f"a wrench of {len(G)} components, one per degree of freedom")
    L = number("normal_force", normal_force, "a force above zero [N]", "a larger bound needs less friction", zero=False)
    w = np.where(moments, w / size, w) / L
    base = np.linalg.lstsq(G, w, rcond=RANK)[0]
    if np.linalg.norm(G @ base - w) > RANK * max(1.0, float(np.linalg.norm(w))):
        return math.inf
    if _by_normals(grasp.contacts.normals, G, w):
        return 0.0
    pushes = _Pushes(grasp.contacts.normals, G, w)
    return _bisected(lambda mu: pushes.has_slack(mu, SLACK))


def _by_normals(normals: FloatArray, G: FloatArray, wrench: FloatArray) -> bool:
    """Return whether normal forces in [0, 1] alone can exert the wrench."""
    from scipy.optimize import linprog

    n, d = normals.shape
    columns = np.einsum("wnd,nd->wn", G.reshape(-1, n, d), normals)
    return bool(linprog(np.zeros(n), A_eq=columns, b_eq=wrench, bounds=(0.0, 1.0)).status == 0)


def _bisected(holds: Callable[[float], bool]) -> float:
    """Find, by bisection, the least coefficient for which a monotone condition holds."""
    if holds(LEAST):
        return 0.0
    low, high = LEAST, 1.0
    while not holds(high):
        low, high = high, 4.0 * high
        if high > LARGEST:
            return math.inf
    while high - low > TOLERANCE * max(1.0, high):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


class _Pushes:
    """Contact forces f = f_0 + Z y that exert one wrench, in units of the bound on the normal forces."""

    def __init__(self, normals: FloatArray, G: FloatArray, wrench: FloatArray) -> None:
        n, d = normals.shape
        U, values, V = np.linalg.svd(G)
        rank = int((values > RANK * values[0]).sum())
        base = V[:rank].T @ ((U[:, :rank].T @ wrench) / values[:rank])
        Z = V[rank:].T.reshape(n, d, -1)
        across = np.eye(d) - normals[:, :, None] * normals[:, None, :]
        # a contact's normal force and tangents as affine functions of x = (y, s)
        self.normal = np.concatenate([np.einsum("nd,ndk->nk", normals, Z), np.zeros((n, 1))], axis=1)
        self.tangent = np.concatenate([across @ Z, np.zeros((n, d, 1))], axis=2)
        self.normal0 = (normals * base.reshape(n, d)).sum(axis=1)
        self.tangent0 = np.einsum("nab,nb->na", across, base.reshape(n, d))

    def has_slack(self, mu: float, least: float) -> bool:
        """Return whether |f_t|/mu <= f_n + s and f_n <= 1 + s for some s of at most `least`."""
        k = self.normal.shape[1]
        unit = np.zeros(k)
        unit[-1] = 1.0
        problem = _Barrier(
            self.normal + unit, self.normal0, self.tangent / mu, self.tangent0 / mu, unit - self.normal,
            1.0 - self.normal0,
        )  # fmt: skip
        x = np.zeros(k)
        x[-1] = 1.0 + max(
            float((np.linalg.norm(self.tangent0, axis=1) / mu - self.normal0).max()), float(self.normal0.max())
        )
        weight = 1.0
        while True:
            x = problem.centre(x, weight)
            gap = 3.0 * len(self.normal) / weight
            if x[-1] <= least or x[-1] - 2.0 * gap > least:
                return bool(x[-1] <= least)
            if gap < 1e-13:
                return bool(x[-1] <= least + 1e-11)
            weight *= GROWTH


@dataclass(frozen=True)
class _Barrier:
    """Cones |t| <= a and half-spaces b >= 0, with a, t and b affine in x."""

    a: FloatArray  # (n, k)
    a0: FloatArray
    t: FloatArray  # (n, d, k)
    t0: FloatArray
    b: FloatArray
    b0: FloatArray

    def centre(self, x: FloatArray, weight: float) -> FloatArray:
        """Minimise weight s - sum log(a^2 - |t|^2) - sum log b, where s is x[-1], by damped Newton steps."""
        for _ in range(STEPS):
            a, t, b = self.a @ x + self.a0, self.t @ x + self.t0, self.b @ x + self.b0
            length = np.linalg.norm(t, axis=1)
            q = (a - length) * (a + length)
            cone = 2.0 * (a[:, None] * self.a - np.einsum("nd,ndk->nk", t, self.t)) / q[:, None]
            flat = self.b / b[:, None]
            gradient = -cone.sum(axis=0) - flat.sum(axis=0)
            gradient[-1] += weight
            H = cone.T @ cone + flat.T @ flat - 2.0 * ((self.a / q[:, None]).T @ self.a)
            spread = (self.t / np.sqrt(q)[:, None, None]).reshape(-1, len(x))
            H += 2.0 * (spread.T @ spread)
            scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
            step = -scale * np.linalg.lstsq(H * np.outer(scale, scale), scale * gradient, rcond=None)[0]
            decrement = float(-gradient @ step)
            if not decrement > 1e-6:
                break
            part = 1.0 / (1.0 + math.sqrt(decrement)) if decrement > 0.06 else 1.0
            while not self.holds(x + part * step):
                part *= 0.5
                if part < 1e-12:
                    return x
            x = x + part * step
        return x

    def holds(self, x: FloatArray) -> bool:
        """Return whether x is strictly inside the cones and half-spaces."""
        a, t = self.a @ x + self.a0, self.t @ x + self.t0
        return bool((a > np.linalg.norm(t, axis=1)).all() and (self.b @ x + self.b0 > 0.0).all())
