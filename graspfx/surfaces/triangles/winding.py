"""Orientation of a surface's triangles: consistent within each piece, outwards, or inwards around a cavity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.surfaces.triangles.tree import FloatArray, IntArray, half_edges

MOST_PIECES = 2000
MOST_WORK = 50_000_000  # largest number of solid angles, which take a few seconds


def wound(vertices: FloatArray, faces: IntArray, *, closed: bool) -> tuple[IntArray, int, int]:
    """Orient faces (f, 3) consistently, and outwards if the surface is closed; count the reversed faces.

    A piece inside another is a cavity and faces inwards. An open piece keeps the orientation of most of its triangles.
    The third result is the number of closed pieces that may cross another.

    Raises:
        InputError: If there are too many pieces, or too many nested pieces.
    """
    across, same, _ = half_edges(faces)
    pieces, turned = _agree(across // 3, same & (across >= 0))
    count, crossing = int(pieces.max()) + 1, 0
    if closed:
        corners = vertices[np.where(turned[:, None], faces[:, ::-1], faces)]
        volume = np.bincount(pieces, tetrahedra(corners - corners.mean(axis=(0, 1))), minlength=count)
        low, high = _boxes(corners, pieces, count)
        cavity = _cavities(corners, pieces, low, high)
        wrong, crossing = (volume < 0.0) != cavity, _crossing(low, high, cavity)
    else:
        wrong = 2 * np.bincount(pieces, turned, minlength=count) > np.bincount(pieces, minlength=count)
    turned = turned ^ wrong[pieces]
    return np.where(turned[:, None], faces[:, ::-1], faces), int(turned.sum()), crossing


def _agree(across: IntArray, same: NDArray[np.bool_]) -> tuple[IntArray, NDArray[np.bool_]]:
    """Number the pieces connected over edges (f,), and mark triangles to reverse so that each piece is consistent."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    n = len(across)
    face, side = np.nonzero(across >= 0)
    graph = coo_array((np.ones(len(face), dtype=np.int8), (face, across[face, side])), shape=(n, n)).tocsr()
    count, pieces = connected_components(graph, directed=False)
    if count > MOST_PIECES:
        raise InputError("mesh", f"{count} pieces", f"at most {MOST_PIECES} disconnected pieces")
    turned = np.zeros(n, dtype=bool)
    for piece in np.unique(pieces[same.any(axis=1)]):
        order, before = breadth_first_order(graph, int(np.flatnonzero(pieces == piece)[0]), directed=False)
        neighbours, sames = across[order].tolist(), same[order].tolist()
        for k in range(1, len(order)):
            to = before[order[k]]
            turned[order[k]] = turned[to] ^ sames[k][neighbours[k].index(to)]
    return pieces.astype(np.intp), turned


def tetrahedra(corners: FloatArray) -> FloatArray:
    """Compute the signed volumes of the tetrahedra between triangles (f, 3, 3) and the origin, (f,)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    volumes: FloatArray = (a * np.cross(b, c)).sum(axis=1) / 6.0
    return volumes


def _boxes(corners: FloatArray, pieces: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Find the lower and upper corners of the boxes around the pieces, (count, 3) each."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, pieces, corners.min(axis=1))
    np.maximum.at(high, pieces, corners.max(axis=1))
    return low, high


def _crossing(low: FloatArray, high: FloatArray, cavity: NDArray[np.bool_]) -> int:
    """Count the pieces whose boxes overlap with another's, except cavities in a piece and pieces in a cavity."""
    within = [((low <= low[k]) & (high[k] <= high)).all(axis=1) for k in range(len(low))]
    hollow = np.array([(each & cavity).sum() > cavity[k] for k, each in enumerate(within)])
    found = 0
    for k, inside in enumerate(within):
        others = ((low < high[k]) & (low[k] < high)).all(axis=1) & ~hollow
        around = ((low[k] <= low) & (high <= high[k])).all(axis=1)
        others[k] = False
        found += not hollow[k] and bool((others & ~(around & cavity) & ~(inside & cavity[k])).any())
    return found


def _cavities(corners: FloatArray, pieces: IntArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """Find the pieces inside an odd number of others, by the others' solid angles as seen from a point of a piece."""
    count = len(low)
    first = np.unique(pieces, return_index=True)[1]
    cavity = np.zeros(count, dtype=bool)
    order = np.argsort(pieces, kind="stable")
    ends = np.cumsum(np.bincount(pieces, minlength=count))
    work = 0
    for piece, point in enumerate(corners[first, 0]):
        around = ((low <= point) & (point <= high)).all(axis=1)
        around[piece] = False
        if not around.any():
            continue
        faces = np.concatenate([order[ends[k - 1] if k else 0 : ends[k]] for k in np.flatnonzero(around)])
        work += len(faces)
        if work > MOST_WORK:
            raise InputError("mesh", f"{count} pieces", "fewer nested pieces", "remove the pieces inside others")
        turns = np.bincount(pieces[faces], _turns(corners[faces] - point), minlength=count)
        cavity[piece] = (np.abs(turns) > 0.5).sum() % 2
    return cavity


def _turns(corners: FloatArray) -> FloatArray:
    """Compute solid angles of triangles (f, 3, 3) at the origin, divided by 4 pi (van Oosterom and Strackee, 1983)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    la, lb, lc = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1), np.linalg.norm(c, axis=1)
    below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    angles: FloatArray = np.arctan2((a * np.cross(b, c)).sum(axis=1), below) / (2.0 * np.pi)
    return angles
