"""Layout of a triangle mesh for the contact kernels, as declared by `mesh_tree.MeshTree`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx import elementary
from graspfx.compile.records import size_for
from graspfx.surfaces.triangles.mesh_tree import MeshTree, Node, Triangle, Vertex

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

LEAF = 4  # largest number of triangles in a leaf
ANGLES = np.frompyfunc(elementary.atan2, 2, 1)  # arctan2 of NumPy depends on the processor


def flatten(vertices: FloatArray, faces: IntArray, *, closed: bool) -> FloatArray:
    """Lay out a mesh as the block of a `MeshTree`, which the contact kernels read.

    Args:
        vertices: Vertices in the object's frame, (v, 3) [m].
        faces: Vertex indices, (f, 3), counter-clockwise seen from outside, none of zero area.
        closed: True if the surface is watertight.
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
    """Build the tree over triangles (f, 3, 3): their order, and each node's box (6,), `skip` and `first`.

    The last row ends the tree: it has no box, and its `first` is f.
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
    """Find the opposite of each half edge (side of a triangle: 3 f + 0, 1, 2 for ab, bc, ca) of faces (f, 3).

    Return the opposite half edge, (f, 3), -1 at a boundary or if more than two triangles share the edge; whether both
    have the same direction, which means that one of the triangles is reversed; and the number of edges with more than
    two triangles.
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
    """List the faces around each vertex, vertex by vertex, and the start of each list (v + 1,)."""
    corner = faces.ravel()
    order = np.argsort(corner, kind="stable")
    return order // 3, np.append(0, np.cumsum(np.bincount(corner, minlength=vertices)))


def face_normals(corners: FloatArray) -> FloatArray:
    """Compute outward unit normals of triangles (f, 3, 3), accurate to the last digit."""
    a, b, c = np.moveaxis(corners.astype(np.longdouble), 1, 0)
    normals = np.cross(b - a, c - a)
    units: FloatArray = (normals / np.sqrt((normals * normals).sum(axis=1, keepdims=True))).astype(np.float64)
    return units


def vertex_normals(corners: FloatArray, faces: IntArray, normals: FloatArray, vertices: int) -> FloatArray:
    """Compute angle-weighted unit pseudonormals (v, 3).

    With them, the sign of the distance is correct at every vertex (Baerentzen and Aanaes, 2005).
    """
    total = np.zeros((vertices, 3))
    for k in range(3):
        u, v = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        angle = ANGLES(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1)).astype(float)
        np.add.at(total, faces[:, k], normals * angle[:, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0.0, length, 1.0)
