"""Neighbours and orientation of triangles, and construction of a `mesh_tree.MeshTree` for the contact kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx import elementary
from graspfx.compile.records import size_for
from graspfx.errors import InputError
from graspfx.surfaces.triangles.mesh_tree import MeshTree, Node, Triangle, Vertex

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

LEAF = 4  # largest number of triangles in a leaf
MOST_PIECES = 2000
MOST_WORK = 50_000_000  # largest number of solid angles in a search for cavities; they take a few seconds
ANGLES = np.frompyfunc(elementary.atan2, 2, 1)  # arctan2 of NumPy depends on the processor


def flatten(vertices: FloatArray, faces: IntArray, *, closed: bool) -> FloatArray:
    """Construct the `MeshTree` of a mesh and return its memory.

    Args:
        vertices: Vertices in the object's frame (v, 3) [m].
        faces: Vertex indices of triangles with non-zero areas (f, 3), counter-clockwise seen from outside.
        closed: Whether the surface is watertight.
    """
    order, boxes, skip, first = box_tree(vertices[faces])
    faces = faces[order]
    corners = vertices[faces]
    normals = face_normals(corners)
    across = half_edges(faces)[0] // 3  # -1 stays -1
    ring, start = rings(faces, len(vertices))
    border = np.zeros(len(vertices))
    for k in range(3):
        ends = across[:, k] < 0
        border[faces[ends, k]] = border[faces[ends, (k + 1) % 3]] = 1.0

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = (high - low).max()
    counts = {"node_count": len(skip) - 1, "triangle_count": len(faces), "vertex_count": len(vertices)}
    mesh = MeshTree(np.zeros(size_for(MeshTree, **counts)))
    mesh.extent, mesh.size, mesh.closed = size + np.abs([low, high]).max(), size, closed
    for name, count in counts.items():
        setattr(mesh, name, count)
    nodes, triangles, points = mesh.nodes, mesh.triangles, mesh.vertices
    nodes.array(Node.low)[:], nodes.array(Node.high)[:] = boxes[:, :3], boxes[:, 3:]
    nodes.array(Node.skip)[:], nodes.array(Node.first)[:] = skip, first
    for k, field in enumerate((Triangle.a, Triangle.b, Triangle.c)):
        triangles.array(field)[:] = corners[:, k]
    triangles.array(Triangle.normal)[:] = normals
    triangles.array(Triangle.across)[:], triangles.array(Triangle.vertices)[:] = across, faces
    points.array(Vertex.pseudonormal)[:] = vertex_normals(corners, faces, normals, len(vertices))
    points.array(Vertex.ring)[:], points.array(Vertex.ring_count)[:] = start[:-1], np.diff(start)
    points.array(Vertex.border)[:] = border
    mesh.buffer[mesh.rings.offset :] = ring
    block: FloatArray = mesh.buffer
    return block


def box_tree(corners: FloatArray) -> tuple[IntArray, FloatArray, IntArray, IntArray]:
    """Build the tree of bounding boxes of triangles (f, 3, 3).

    Returns:
        Order of the triangles in the tree (f,); and, for each node and for the final entry of `MeshTree.nodes`, lower
        and upper corner of the box (nodes + 1, 6), `skip` and `first` (see `Node`).
    """
    count = len(corners)
    depth = max(0, int(np.ceil(np.log2(count / LEAF))))
    low, high = corners.min(axis=1), corners.max(axis=1)
    centres = 0.5 * (low + high)
    order = np.arange(count)
    total = 2 ** (depth + 1) - 1
    first, below = np.zeros(total + 1, dtype=np.intp), np.zeros(total + 1, dtype=np.intp)
    levels = []
    number = np.zeros(1, dtype=np.intp)
    for level in range(depth + 1):
        starts = np.arange(2**level) * count // 2**level
        beneath = 2 ** (depth - level + 1) - 1  # number of nodes of the subtree
        first[number], below[number] = starts, number + beneath
        levels.append((number, starts))
        if level < depth:
            sizes = np.diff(np.append(starts, count))
            part = np.repeat(np.arange(2**level), sizes)
            ordered = centres[order]
            sides = np.maximum.reduceat(ordered, starts) - np.minimum.reduceat(ordered, starts)
            along = np.take_along_axis(ordered, sides.argmax(axis=1)[part][:, None], axis=1)[:, 0]
            order = order[np.lexsort((along, part))]
            number = np.column_stack([number + 1, number + 1 + beneath // 2]).ravel()
    boxes = np.zeros((total + 1, 6))
    for number, starts in levels:
        boxes[number, :3] = np.minimum.reduceat(low[order], starts)
        boxes[number, 3:] = np.maximum.reduceat(high[order], starts)
    first[total], below[total] = count, total + 1
    return order, boxes, below, first


def half_edges(faces: IntArray) -> tuple[IntArray, NDArray[np.bool_], int]:
    """Find the opposite of each half edge of faces (f, 3).

    The half edges of triangle k with vertices a, b, c are its sides: 3 k (ab), 3 k + 1 (bc) and 3 k + 2 (ca).

    Returns:
        Number of the opposite half edge (f, 3), or -1 at a boundary and if more than two triangles share the edge;
        whether a half edge and its opposite have the same direction, so that one of the two triangles is reversed
        (f, 3); and the number of edges that more than two triangles share.
    """
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = sides.min(axis=1), sides.max(axis=1)
    order = np.lexsort((high, low))
    starts = np.flatnonzero(np.append(True, (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)))
    counts = np.diff(np.append(starts, len(order)))
    pairs = starts[counts == 2]
    one, other = order[pairs], order[pairs + 1]
    opposite = np.full(len(sides), -1, dtype=np.intp)
    opposite[one], opposite[other] = other, one
    same = np.zeros(len(sides), dtype=bool)
    same[one] = same[other] = sides[one, 0] == sides[other, 0]
    return opposite.reshape(-1, 3), same.reshape(-1, 3), int((counts > 2).sum())


def rings(faces: IntArray, vertices: int) -> tuple[IntArray, IntArray]:
    """Return the faces around each vertex, one vertex after the other (3 f,), and where each vertex starts (v + 1,)."""
    corner = faces.ravel()
    order = np.argsort(corner, kind="stable")
    return order // 3, np.append(0, np.cumsum(np.bincount(corner, minlength=vertices)))


def face_normals(corners: FloatArray) -> FloatArray:
    """Compute the outward unit normals (f, 3) of triangles (f, 3, 3), in extended precision if it is available."""
    a, b, c = np.moveaxis(corners.astype(np.longdouble), 1, 0)
    normals = np.cross(b - a, c - a)
    units: FloatArray = (normals / np.sqrt((normals * normals).sum(axis=1, keepdims=True))).astype(np.float64)
    return units


def vertex_normals(corners: FloatArray, faces: IntArray, normals: FloatArray, vertices: int) -> FloatArray:
    """Compute the angle-weighted unit pseudonormals of the vertices (v, 3).

    If a vertex is the point of the surface nearest to a finger, the sign of the dot product of the pseudonormal and the
    vector from the vertex to the finger shows whether the finger is outside (Baerentzen and Aanaes, 2005).
    """
    total = np.zeros((vertices, 3))
    for k in range(3):
        u, v = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        angle = ANGLES(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1)).astype(float)
        np.add.at(total, faces[:, k], normals * angle[:, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0.0, length, 1.0)


# Orientation: consistent within each piece, outwards, or inwards around a cavity --------------------------------------


def wound(vertices: FloatArray, faces: IntArray, *, closed: bool) -> tuple[IntArray, int, int]:
    """Orient faces (f, 3) consistently within each connected piece.

    A piece of a closed surface faces outwards; a piece inside another piece is a cavity, and faces inwards. A piece of
    an open surface gets the orientation of the majority of its triangles.

    Returns:
        Faces, number of faces that were reversed, and number of closed pieces that may intersect another piece.

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
    """Return the number of each triangle's connected piece (f,), and a mask (f,) of triangles to reverse.

    Reversing the marked triangles makes the orientation of each piece consistent.
    """
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
    """Compute the signed volumes (f,) of the tetrahedra between triangles (f, 3, 3) and the origin."""
    a, b, c = np.moveaxis(corners, 1, 0)
    volumes: FloatArray = (a * np.cross(b, c)).sum(axis=1) / 6.0
    return volumes


def _boxes(corners: FloatArray, pieces: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corners, each (count, 3), of the bounding boxes of the pieces."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, pieces, corners.min(axis=1))
    np.maximum.at(high, pieces, corners.max(axis=1))
    return low, high


def _crossing(low: FloatArray, high: FloatArray, cavity: NDArray[np.bool_]) -> int:
    """Count the pieces whose box overlaps with the box of another piece.

    Cavities inside a piece, and pieces inside a cavity, are not counted.
    """
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
    """Return a mask of the pieces that are inside an odd number of other pieces.

    A piece is inside another piece if the solid angle of the other piece, seen from a vertex of the first, is not zero.
    """
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
    """Compute the solid angles of triangles (f, 3, 3) at the origin, divided by 4 pi (van Oosterom, Strackee 1983)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    la, lb, lc = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1), np.linalg.norm(c, axis=1)
    below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    angles: FloatArray = np.arctan2((a * np.cross(b, c)).sum(axis=1), below) / (2.0 * np.pi)
    return angles
