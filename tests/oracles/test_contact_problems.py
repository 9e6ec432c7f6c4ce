"""Frictional contact problems that others published: Coulomb's law between r and u = W r + q, bounds in m/s and N s.

Their contacts are rigid, W is singular or nearly so; here each is given a compliance of 1e-9 of W's largest entry, by
which u then misses the law.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import graspfx as gx

FloatArray = NDArray[np.float64]
DATA = Path(__file__).parent / "contact_problems"
COMPLIANCE = 1e-9


def solved(W: FloatArray, q: FloatArray, mu: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Impulses r and velocities u (n, 3), the normal first, by `unilateral_force`: f = K (e + s), K = W^-1, e = -q."""
    n = len(mu)
    normals = np.zeros((n, 3))
    normals[:, axis] = 1.0
    K = np.linalg.inv(W + COMPLIANCE * np.abs(W).max() * np.eye(len(W)))
    touch = gx.unilateral_force((K + K.T) / 2, -q, normals, mu.tolist())
    assert touch.law == "coulomb"
    order = [axis, *(a for a in range(3) if a != axis)]
    u = W @ touch.force + q
    return touch.force.reshape(n, 3)[:, order], u.reshape(n, 3)[:, order]


def misses(r: FloatArray, u: FloatArray, mu: FloatArray) -> tuple[float, float]:
    """By how much r misses its cones; and u the law: u_n >= 0, r_n u_n = 0 where r_n presses, slip against r_t."""
    cone = max(float(-r[:, 0].min()), float((np.linalg.norm(r[:, 1:], axis=1) - mu * r[:, 0]).max()))
    pressing = r[:, 0] > 1e-6 * r[:, 0].max()
    inside = np.linalg.norm(r[:, 1:], axis=1) < mu * r[:, 0] * (1.0 - 1e-6)
    slip = np.linalg.norm(u[:, 1:], axis=1)
    along = np.abs((r[:, 1:] * u[:, 1:]).sum(axis=1) + mu * r[:, 0] * slip) / np.maximum(mu * r[:, 0], 1e-300)
    parts = [-u[:, 0], np.abs(u[pressing, 0]), slip[pressing & inside], along[pressing]]
    return cone, max(float(each.max(initial=0.0)) for each in parts)


@pytest.mark.parametrize(("name", "bound"), [("sliding_cube", 1e-8), ("2cubes_t0", 1e-4)])
def test_contactbench(name: str, bound: float) -> None:
    """A cube that slides, two that lie on each other: of velocities of 1.3 and 0.01 m/s."""
    with np.load(DATA / f"{name}.npz") as problem:
        W, q, mu = problem["G"], problem["g"].ravel(), problem["mus"]
    r, u = solved(W, q, mu, 2)
    cone, law = misses(r, u, mu)
    assert cone < 1e-12 and law < bound


def test_fclib() -> None:
    """48 contacts of stacked boxes, rank 72 of 144."""
    with h5py.File(DATA / "local_problem_test.hdf5") as file:
        parts = [file[f"fclib_local/W/{name}"][:] for name in ("x", "i", "p")]
        q, mu = file["fclib_local/vectors/q"][:], file["fclib_local/vectors/mu"][:]
    W = sparse.csc_matrix(tuple(parts)).toarray()
    r, u = solved(W, q, mu, 0)
    cone, law = misses(r, u, mu)
    assert cone < 1e-12 and law < 1e-8
