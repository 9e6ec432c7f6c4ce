"""Oracles at 50 digits, built from the definitions and from nothing of GraspFX."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DIGITS = 50


def exact_share(points: FloatArray, e: FloatArray, tolerance: float) -> tuple[list[Any], int]:
    """P e = G'(G G')^+ G e of hard contacts that are free in every direction, (n d,), and the rank of G.

    Moments about the centroid, in units of the rms radius R; a unit motion counts if it moves the contacts by more than
    `tolerance` R as a root mean square.
    """
    n, d = points.shape
    with mp.workdps(DIGITS):
        x = [[mp.mpf(v) for v in row] for row in points.tolist()]
        motion = [mp.mpf(v) for v in e.ravel().tolist()]
        centre = [sum(row[a] for row in x) / n for a in range(d)]
        arms = [[row[a] - centre[a] for a in range(d)] for row in x]
        size = mp.sqrt(sum(v * v for row in arms for v in row) / n) or mp.mpf(1)
        rows: list[list[Any]] = []
        for a in range(d):
            rows.append([mp.mpf(int(a == b)) for _ in range(n) for b in range(d)])
        if d == 2:
            rows.append([v / size for r in arms for v in (-r[1], r[0])])
        if d == 3:
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                rows.append([])
                for r in arms:
                    turned = [mp.mpf(0)] * 3
                    turned[b], turned[c] = -r[c], r[b]
                    rows[-1] += [v / size for v in turned]
        w = len(rows)
        gram = mp.matrix(w)
        for i in range(w):
            for j in range(w):
                gram[i, j] = mp.fdot(rows[i], rows[j])
        wrench = mp.matrix([mp.fdot(row, motion) for row in rows])
        values, vectors = mp.eigsy(gram)
        kept = [k for k in range(w) if values[k] > tolerance**2 * n]
        rigid = mp.matrix(w, 1)
        for k in kept:
            v = vectors[:, k]
            rigid += v * ((v.T * wrench)[0] / values[k])
        return [mp.fdot([row[j] for row in rows], rigid) for j in range(n * d)], len(kept)


def exact_force(
    points: FloatArray, e: FloatArray, external: float, internal: float, tolerance: float
) -> tuple[list[Any], int]:
    """f = k_i e + (k_e - k_i) P e, (n d,), and the rank of G."""
    share, rank = exact_share(points, e, tolerance)
    with mp.workdps(DIGITS):
        ke, ki = mp.mpf(external), mp.mpf(internal)
        return [ki * mp.mpf(v) + (ke - ki) * p for v, p in zip(e.ravel().tolist(), share, strict=True)], rank


def distance(found: FloatArray, exact: list[Any]) -> float:
    """max |found - exact|."""
    with mp.workdps(DIGITS):
        return max(float(abs(mp.mpf(v) - x)) for v, x in zip(np.ravel(found).tolist(), exact, strict=True))
