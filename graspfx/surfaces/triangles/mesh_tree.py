"""Memory layout of a triangle mesh (triangles, pseudonormals, tree of bounding boxes) and of a finger's state on it."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, floats, many, start_of
from graspfx.spatial import Vector

NEW, FREE, TOUCHING = 0, 1, 2  # modes of a finger


class Node(Record):
    """Node of the tree of bounding boxes. Nodes are stored in preorder, so that a traversal needs no stack."""

    low: Vector  # lower corner of the box
    high: Vector
    skip: int  # index of the next node that is not below this one; for a leaf, of the next node
    first: int  # index of its first triangle; its triangles end where those of node `skip` begin


class Triangle(Record):
    """Triangle with vertices a, b, c. Its features are 0 (interior), 1, 2, 3 (edges ab, bc, ca), 4, 5, 6 (a, b, c)."""

    a: Vector  # vertices, counter-clockwise seen from outside
    b: Vector
    c: Vector
    normal: Vector  # outward unit normal
    across: Floats = floats("3")  # indices of the triangles across ab, bc, ca; -1 at a boundary
    vertices: Floats = floats("3")  # indices of a, b, c


class Vertex(Record):
    """Data of a vertex; its coordinates are stored in the triangles."""

    pseudonormal: Vector  # outward unit vector: the triangles' normals weighted by their angles
    ring: int  # index of its first triangle in `rings`
    ring_count: int  # number of its triangles
    border: bool  # True on the boundary of the surface


class MeshTree(Record):
    """Mesh with a complete binary tree of bounding boxes.

    The triangles of a node are halved along the longest side of the box around their centres.
    """

    extent: float  # size of the bounding box plus the largest coordinate, to which rounding is relative [m]
    size: float  # longest side of the bounding box [m]
    closed: bool  # True if watertight; a shell is touched from its front only
    node_count: int
    triangle_count: int
    vertex_count: int
    nodes: Many[Node] = many("node_count + 1")  # the last node has no box; its `first` is the triangle count
    triangles: Many[Triangle] = many("triangle_count")
    vertices: Many[Vertex] = many("vertex_count")
    rings: Floats = floats("3 * triangle_count")  # indices of the triangles around each vertex


def choices(offset: int) -> list[int]:
    """Return the positions of the entries of a mesh that select code paths in kernels: `closed`, and the counts.

    Args:
        offset: Position of the mesh in the memory of the kernels.
    """
    names = ("closed", "node_count", "triangle_count", "vertex_count")
    return [offset + start_of(MeshTree, name) for name in names]


class Plane(Record):
    """Constraint of a ball's proxy x: n . x >= distance, with the unit normal n of the plane."""

    normal: Vector  # n_j
    distance: float  # n_j . c_j + radius
    triangle: int  # index of the plane's triangle
    feature: int  # feature of the triangle


class MeshFinger(Record):
    """State of a finger on a mesh. All entries of a new finger are zero, except `reach`."""

    mode: int  # NEW, FREE or TOUCHING
    face: int  # face of the contact point
    feature: int  # feature of the face: 0 inside, 1 2 3 on ab bc ca, 4 5 6 at a b c
    point: Vector  # contact point, object's frame [m]
    inward: Vector  # unit normal into the object
    last: Vector  # last position of the finger, or of a ball's proxy [m]
    safe: float  # radius around `last` that is free of the surface [m]
    reach: float  # largest distance of finger or ball's centre at which the contact point is the nearest one [m]
    planes: Many[Plane] = many("4")  # for a ball: up to three active planes, and a candidate
