"""Touching fingers found by trying every set of them."""

from __future__ import annotations

import itertools

import numpy as np


def every_subset(K: np.ndarray, e: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The friction-free answer by trying every set of touching fingers."""
    n, d = normals.shape
    N = np.zeros((n * d, n))
    for i in range(n):
        N[i * d : (i + 1) * d, i] = normals[i]
    A, g = N.T @ np.linalg.inv(K) @ N, N.T @ e  # minimise 1/2 l'A l - l'g over l >= 0
    best = None
    for k in range(n + 1):
        for subset in itertools.combinations(range(n), k):
            s = list(subset)
            force = np.zeros(n)
            if s:
                force[s] = np.linalg.solve(A[np.ix_(s, s)], g[s])
            if (force >= -1e-12).all() and (A @ force - g >= -1e-12).all():
                best = force
    assert best is not None
    return N @ best
