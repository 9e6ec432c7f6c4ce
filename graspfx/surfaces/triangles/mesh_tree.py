"""A triangle mesh as it stands in a block: triangles, neighbours, pseudonormals, and a tree of boxes around them."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, floats, many, start_of
from graspfx.spatial import Vector


class Node(Record):
    """A node of the tree. Nodes stand in preorder, so that a walk over the tree needs no stack."""

    low: Vector  # corners of the box
    high: Vector
    skip: int  # number of the next node that is not below this one; that of a leaf is the next one
    first: int  # number of its first triangle; a node's triangles end where those of node `skip` begin


class Triangle(Record):
    """A triangle; its features are 0 inside, 1 2 3 on ab bc ca, 4 5 6 at a b c."""

    a: Vector  # counter-clockwise seen from outside
    b: Vector
    c: Vector
    normal: Vector  # unit, outwards
    across: Floats = floats("3")  # numbers of the triangles across ab, bc, ca; -1 where the surface ends
    vertices: Floats = floats("3")  # numbers of a, b, c


class Vertex(Record):
    """A vertex, as far as its triangles do not say."""

    pseudonormal: Vector  # unit, outwards: the triangles' normals weighted by their angles
    ring: int  # where its triangles begin in `rings`
    ring_count: int  # how many they are
    border: bool  # the surface ends here


class MeshTree(Record):
    """A mesh, its tree complete: every level halves its triangles along the longest side of their centres' box."""

    extent: float  # size of the bounding box plus the largest coordinate, to which rounding is relative [m]
    size: float  # longest side of the bounding box [m]
    closed: bool  # watertight; else a shell, which is touched from its front only
    node_count: int
    triangle_count: int
    vertex_count: int
    nodes: Many[Node] = many("node_count + 1")  # the last one is the end: no box, and where triangles end
    triangles: Many[Triangle] = many("triangle_count")
    vertices: Many[Vertex] = many("vertex_count")
    rings: Floats = floats("3 * triangle_count")  # numbers of the triangles around each vertex


def choices(offset: int) -> list[int]:
    """List the entries of the mesh at an offset that pick what kernels do: whether it is closed, and its sizes."""
    names = ("closed", "node_count", "triangle_count", "vertex_count")
    return [offset + start_of(MeshTree, name) for name in names]
