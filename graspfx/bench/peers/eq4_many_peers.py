"""Eq. (4) for stacks of contact sets, as a reader of the paper would write it with numpy's stacked linear algebra."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.peers.eq4_peers import SKEW

FloatArray = NDArray[np.float64]


def stacked_matrices(points: FloatArray) -> FloatArray:
    """Form G of many sets of point contacts in space (N, n, 3), moments about the origin: (N, 6, 3 n)."""
    N, n, _ = points.shape
    G = np.empty((N, 6, 3 * n))
    G[:, :3] = np.tile(np.eye(3), (1, n))
    turned = (points.reshape(-1, 3) @ SKEW.reshape(9, 3).T).reshape(N, n, 3, 3)
    G[:, 3:].reshape(N, 3, n, 3)[...] = turned.transpose(0, 2, 1, 3)
    return G


def many_by_pinv(points: FloatArray, x: FloatArray) -> FloatArray:
    """Compute P x with P = G^+ G (eq. 3) from the right, all sets at once."""
    G = stacked_matrices(points)
    return np.asarray(np.linalg.pinv(G) @ (G @ x.reshape(len(x), -1, 1))).reshape(x.shape)


def many_by_solve(points: FloatArray, x: FloatArray) -> FloatArray:
    """Solve the normal equations G G' v = G x of all sets at once; LinAlgError where one is singular."""
    G = stacked_matrices(points)
    transposed = np.swapaxes(G, 1, 2)
    return np.asarray(transposed @ np.linalg.solve(G @ transposed, G @ x.reshape(len(x), -1, 1))).reshape(x.shape)


def many_by_moments(points: FloatArray, x: FloatArray) -> FloatArray:
    """Compute P x without G: the mean shift and the turn w about the centroid, J w = sum r x d, of all sets at once."""
    r = points - points.mean(axis=1, keepdims=True)
    mean = x.mean(axis=1, keepdims=True)
    moments = np.matmul(np.swapaxes(r, 1, 2), np.concatenate([x, r], axis=2))  # sum r d', sum r r'
    m, S = moments[:, :, :3], moments[:, :, 3:]
    J = np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S
    about = np.stack([m[:, 1, 2] - m[:, 2, 1], m[:, 2, 0] - m[:, 0, 2], m[:, 0, 1] - m[:, 1, 0]], axis=1)
    w = np.linalg.solve(J, about[..., None])[..., 0]
    turn = (w @ SKEW.reshape(9, 3).T).reshape(-1, 3, 3)  # [w x]
    return np.asarray(mean + r @ np.swapaxes(turn, 1, 2))


MANY_PEERS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "numpy pinv, stacked": many_by_pinv,
    "numpy solve, stacked": many_by_solve,
    "numpy, closed form, stacked": many_by_moments,
}
