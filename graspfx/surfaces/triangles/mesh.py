"""Triangle meshes: reading, validation, repair, mass properties, and layout for the contact kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike, fspath
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from graspfx.compile.records import Many, size_of, start_of
from graspfx.errors import InputError
from graspfx.numeric import finite, number, real
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form import proxy
from graspfx.surfaces.closed_form.shape import Contacts, contacts
from graspfx.surfaces.triangles.ball import ball_contact
from graspfx.surfaces.triangles.mesh_file import MOST_BYTES, MOST_TRIANGLES, read_mesh_file
from graspfx.surfaces.triangles.mesh_tree import MeshFinger, MeshTree
from graspfx.surfaces.triangles.tree import FloatArray, IntArray, flatten, half_edges, tetrahedra, wound
from graspfx.surfaces.triangles.walk import mesh_contact

STATE = size_of(MeshFinger)  # entries of a finger's state on a mesh
ROTATIONS = 12  # sweeps over three rotations; four or five suffice
FLAT = 1e-13  # relative to the mesh: a triangle of smaller height has no normal
SAME_POINT = 1e-6  # relative distance at which vertices of an open mesh are merged
ROUNDS = 100  # number of passes that cut at triangles without area; any that remain leave the surface open
LEAST_VOLUME = 1e-15  # relative to the cube of the largest side: a smaller volume is rounding
SHARP = 1e-9  # relative rounding of the moments of a flat or straight body
ALIGNED = 1e-9  # relative to the moments: smaller products of inertia keep the axes of the file


@dataclass(frozen=True)
class MassProperties:
    """Mass properties of a mesh, in the frame of the mesh.

    Attributes:
        mass: Mass [kg].
        centre: Centre of mass (3,) [m].
        inertia: Inertia matrix about the centre of mass (3, 3) [kg m^2].
        moments: Principal moments of inertia (3,) [kg m^2].
        axes: Principal axes, right-handed, as columns (3, 3); the identity if the products of inertia vanish.
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray
    moments: FloatArray
    axes: FloatArray


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh that has been validated for contact. Use `make_mesh` or `load_mesh` to create one.

    Attributes:
        vertices: Vertices (v, 3) [m].
        faces: Vertex indices of the triangles (f, 3), counter-clockwise seen from outside.
        shell: Whether the mesh is a surface that may be open, without a volume; fingers touch only its front.
        notes: Descriptions of repairs and warnings, one sentence each.
    """

    vertices: FloatArray
    faces: IntArray
    shell: bool = False
    notes: tuple[str, ...] = ()
    kind: ClassVar[int] = proxy.MESH
    endless: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[float, float, float]:
        """Zeros; a mesh is described by `data` alone."""
        return 0.0, 0.0, 0.0

    def dimensions_ok(self, d: int) -> bool:
        """Return whether meshes exist in d dimensions: only for d = 3."""
        return d == 3

    @cached_property
    def data(self) -> FloatArray:
        """Memory of the `MeshTree` that the contact kernels read."""
        return flatten(self.vertices, self.faces, closed=not self.shell)

    def contact(self, points: ArrayLike, state: FloatArray | None = None, *, radius: float = 0.0) -> Contacts:
        """Find the contact points of n fingers.

        Args:
            points: Positions of the fingertips, or of their centres, in the mesh's frame (n, 3) [m].
            state: State of the fingers from `new_fingers`, which is updated in place (n, STATE). If None, all fingers
                are new, and the contact points are the nearest points of the surface.
            radius: Radius of the fingertips [m]; zero for point fingertips.

        Raises:
            InputError: If `points` or `state` has a wrong shape, or a value is not finite.
        """
        p = finite("points", points, "finite positions of shape (n, 3)", largest=np.inf)
        if p.ndim != 2 or p.shape[1] != 3:
            raise InputError("points", points, "finite positions of shape (n, 3)")
        S = new_fingers(len(p)) if state is None else state
        if getattr(S, "shape", None) != (len(p), STATE) or S.dtype != np.float64 or not S.flags.c_contiguous:
            raise InputError("state", state, f"the array that new_fingers({len(p)}) returns")
        radius = number("radius", radius, "a finite length, zero or more [m]")
        mesh = MeshTree(memoryview(self.data))
        fingers: Many[MeshFinger] = Many(MeshFinger, memoryview(S.reshape(-1)), 0, len(p))
        if radius > 0.0:
            each = [ball_contact(mesh, f, radius, Vector(*x)) for f, x in zip(fingers, p.tolist(), strict=True)]
        else:
            each = [mesh_contact(mesh, f, Vector(*x)) for f, x in zip(fingers, p.tolist(), strict=True)]
        return contacts(each, 3)

    def mass_properties(self, *, mass: float | None = None, density: float | None = None) -> MassProperties:
        """Compute the mass properties of a homogeneous solid or, for a shell, of its surface.

        Args:
            mass: Mass [kg].
            density: Density [kg/m^3], which may be given instead of the mass, but not for a shell.

        Raises:
            InputError: If neither or both of `mass` and `density` are given; a density is given for a shell; the
                surface encloses no volume; or the surface intersects itself so that the moments of inertia are invalid.
        """
        amount = mass if mass is not None else density
        name = "mass" if mass is not None else "density"
        if amount is None or (mass is not None and density is not None):
            raise InputError("mass", (mass, density), "either a mass or a density")
        amount = number(name, amount, "finite and above zero", zero=False)
        if self.shell and density is not None:
            raise InputError("density", density, "the mass of a shell", "a surface has no volume: pass `mass` instead")
        middle = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        size = float(np.ptp(self.vertices, axis=0).max())
        unit = (self.vertices - middle) / size
        volume, centre, inertia = (_surface_properties if self.shell else _solid_properties)(unit[self.faces])
        if not volume > LEAST_VOLUME:
            body = f"a surface that encloses {volume * size**3:.3g} m^3"
            do = "the surface is flat or intersects itself: repair the file"
            raise InputError("mesh", body, "a surface that encloses a volume", do)
        weight = amount if mass is not None else amount * volume * size**3
        inertia = np.asarray(inertia, dtype=np.float64) * (weight / volume * size**2)
        moments, axes = _principal(0.5 * (inertia + inertia.T))
        if not 2.0 * moments.max() <= (1.0 + SHARP) * moments.sum() or not moments.min() > 0.0:
            solid = f"principal moments of {moments[0]:.3g}, {moments[1]:.3g} and {moments[2]:.3g} kg m^2"
            do = "the surface intersects itself, so that parts of its volume are negative: repair the file"
            expected = "moments of inertia that are positive, and none larger than the sum of the other two"
            raise InputError("mesh", solid, expected, do)
        return MassProperties(float(weight), middle + size * centre, inertia, moments, axes)

    def seen_from(self, centre: FloatArray, axes: FloatArray) -> Mesh:
        """Return the mesh in another frame, such as the frame of its centre of mass and principal axes.

        Args:
            centre: Origin of the other frame (3,) [m].
            axes: Axes of the other frame as columns (3, 3).
        """
        return replace(self, vertices=np.einsum("vi,ij->vj", self.vertices - centre, axes))


def new_fingers(count: int, reach: float = np.inf) -> FloatArray:
    """Return the states (count, STATE) of new fingers for `Mesh.contact`.

    Args:
        count: Number of fingers.
        reach: Largest distance of a finger from the surface at which its contact point must be exact [m].
    """
    state = np.zeros((count, STATE))
    state[:, start_of(MeshFinger, "reach")] = reach
    return state


def load_mesh(
    path: str | PathLike[str],
    *,
    scale: float = 1.0,
    shell: bool = False,
    most_bytes: int = MOST_BYTES,
    most_triangles: int = MOST_TRIANGLES,
) -> Mesh:
    """Load a mesh from an STL, OBJ, PLY, OFF or GLB file.

    Only positions and triangles are read; materials and referenced files are ignored.

    Args:
        path: Path of the file.
        scale: Factor on all positions; 0.001 for a file in millimetres.
        shell: Whether the mesh is a surface that may be open; see `Mesh`.
        most_bytes: Largest accepted size of the file [bytes].
        most_triangles: Largest accepted number of triangles.

    Raises:
        InputError: If the file cannot be read, exceeds `most_bytes` or `most_triangles`, or does not contain a valid
            surface.
        MissingPackageError: If trimesh is not installed.
    """
    vertices, faces = read_mesh_file(path, most_bytes, most_triangles)
    return make_mesh(vertices, faces, scale=scale, shell=shell, name=fspath(path).replace("\\", "/").rpartition("/")[2])


def make_mesh(
    vertices: ArrayLike, faces: ArrayLike, *, scale: float = 1.0, shell: bool = False, name: str = "mesh"
) -> Mesh:
    """Make a mesh from vertices and triangles, with validation and repair.

    Equal vertices are merged. If the surface then has open edges and is not a shell, vertices that are equal after
    rounding to 1e-6 of the mesh's size are merged. Triangles without area are removed, and a neighbour across the
    longest side of such a triangle is split at the middle vertex. Triangles with the wrong orientation are reversed.
    The mesh's `notes` list these repairs, except the merging of equal vertices.

    Args:
        vertices: Vertices (v, 3).
        faces: Vertex indices of the triangles (f, 3).
        scale: Factor that converts the vertices to metres.
        shell: Whether the mesh is a surface that may be open; see `Mesh`.
        name: Name of the mesh in error messages.

    Raises:
        InputError: If a value is not finite, there are no triangles, or the mesh has too many disconnected pieces; or,
            unless `shell` is True, if the surface is open, or more than two triangles share an edge.
    """
    scale = number("scale", scale, "finite and above zero", zero=False)
    v = real(name, vertices, "finite coordinates")
    corners = finite("faces", faces, "integer vertex indices")
    if v.ndim != 2 or v.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3 or not len(corners):
        raise InputError(
            name, f"{v.shape} vertices, {corners.shape} faces", "a surface of triangles: (v, 3) and (f, 3)"
        )
    if (corners % 1.0).any() or corners.min() < 0 or corners.max() >= len(v):
        raise InputError("faces", corners, f"integer vertex indices from 0 to {len(v) - 1}")
    f = corners.astype(np.intp)
    v[f] = scale * finite(name, v[f], "finite coordinates")
    size = float(np.ptp(v[f].reshape(-1, 3), axis=0).max())
    if not size > 0.0:
        raise InputError(name, "all vertices at one point", "a surface larger than a point")

    notes = []
    apart, count = (v, f), len(f)
    v, f, dropped, cut = _joined(*apart, 0.0, size)
    if not shell and _open_edges(f):
        v, f, dropped, cut = _joined(*apart, SAME_POINT * size, size)
        notes.append(f"vertices within about {SAME_POINT * size:.1g} m were merged to close the surface")
    if not len(f):
        raise InputError(name, "triangles without area only", "a surface of triangles")
    if dropped:
        notes.append(f"{dropped} of {count} triangles had no area and were removed")
    if cut:
        notes.append(f"{cut} triangles were split at a vertex in the middle of their side")
    crowded = half_edges(f)[2]
    if not shell and (crowded or _open_edges(f)):
        fault = f"{_open_edges(f)} open edges, {crowded} with more than two triangles"
        do = "close the surface, or set shell = true, so that fingers touch only its front"
        raise InputError(name, fault, "a watertight surface", f"unite solids that touch, {do}" if crowded else do)
    f, turned, crossing = wound(v, f, closed=not shell)
    if turned == len(f):
        notes.append("all triangles faced inwards and were reversed")
    elif turned:
        notes.append(f"{turned} of {len(f)} triangles had the wrong orientation and were reversed")
    if crossing:
        notes.append(
            f"{crossing} closed surfaces may intersect: their common volume is counted twice or not at all, and "
            "fingers touch faces inside this volume; unite the solids, for example with trimesh.boolean.union"
        )
    return Mesh(v, f, shell, tuple(notes))


def _joined(v: FloatArray, f: IntArray, distance: float, size: float) -> tuple[FloatArray, IntArray, int, int]:
    """Merge vertices that are equal after rounding to `distance` [m], and remove triangles without area.

    Returns:
        Vertices, triangles, number of removed triangles, and number of triangles that were split.
    """
    used, index = np.unique(f, return_inverse=True)
    points = v[used] + 0.0  # turns minus zero into zero
    keys = np.round(points / distance) if distance else points
    _, first, label = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    f = label.reshape(-1)[index].reshape(-1, 3)
    whole = (f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])
    f, flat, cut = _without_area(points[first], f[whole], FLAT * size)
    used, index = np.unique(f, return_inverse=True)
    return points[first][used], index.reshape(-1, 3), int((~whole).sum()) + flat, cut


def _without_area(v: FloatArray, f: IntArray, height: float) -> tuple[IntArray, int, int]:
    """Remove triangles with collinear vertices, and split the neighbours across their longest sides.

    A neighbour is split at the middle vertex of the collinear vertices.

    Args:
        height: Height up to which the vertices of a triangle are collinear [m].

    Returns:
        Triangles, number of removed triangles, and number of triangles that were split.
    """
    f = f.copy()
    dropped = cut = 0
    for _ in range(ROUNDS):
        sides = np.linalg.norm(v[f[:, [1, 2, 0]]] - v[f], axis=2)
        doubled = np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1)
        flat = doubled <= height * sides.max(axis=1)
        if not flat.any():
            break
        neighbours = half_edges(f)[0]
        without = np.zeros(len(f), dtype=bool)
        busy = np.zeros(len(f), dtype=bool)
        added = []
        for k in np.flatnonzero(flat).tolist():
            long = int(sides[k].argmax())
            other, side = divmod(int(neighbours[k, long]), 3)
            if busy[k] or (other >= 0 and (busy[other] or (flat[other] and other > k))):
                continue  # postponed until the next pass
            without[k] = busy[k] = True
            dropped += 1
            if other >= 0:
                a, b, c = f[other, side], f[other, (side + 1) % 3], f[other, (side + 2) % 3]
                middle = f[k, (long + 2) % 3]
                without[other] = busy[other] = True
                added += [(a, middle, c), (middle, b, c)]
                cut += 1
        f = np.vstack([f[~without], np.array(added, dtype=np.intp).reshape(-1, 3)])
        twice = (f[:, 0] == f[:, 1]) | (f[:, 1] == f[:, 2]) | (f[:, 2] == f[:, 0])
        dropped += int(twice.sum())
        f = f[~twice]
    return f, dropped, cut


def _open_edges(f: IntArray) -> int:
    """Count the sides of triangles that coincide with no side, or with more than one side, of other triangles."""
    return int((half_edges(f)[0] < 0).sum()) if len(f) else 0


def _principal(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    products = np.abs(inertia - np.diag(np.diag(inertia))).max()
    if products <= ALIGNED * np.diag(inertia).max():
        return np.diag(inertia).copy(), np.eye(3)
    moments, axes = _eigen(inertia)
    for k in (0, 1):  # choose the sign that keeps each axis close to one of the file's
        axes[:, k] *= np.sign(axes[np.abs(axes[:, k]).argmax(), k])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


def _eigen(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute eigenvalues, in ascending order, and eigenvectors, as columns, of a symmetric matrix (3, 3).

    Jacobi rotations are used instead of LAPACK, whose rounding errors depend on the processor.
    """
    A, Q = A.copy(), np.eye(3)
    for _ in range(ROTATIONS):
        for i, j in ((0, 1), (0, 2), (1, 2)):
            if abs(A[i, j]) > 1e-17 * (abs(A[i, i]) + abs(A[j, j])):
                theta = 0.5 * float(A[j, j] - A[i, i]) / float(A[i, j])
                t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = c * t
                for M in (A.T, A, Q.T):  # columns, then rows, of A; columns of Q
                    M[i], M[j] = c * M[i] - s * M[j], s * M[i] + c * M[j]
    order = np.argsort(np.diag(A))
    return np.diag(A)[order], Q[:, order]


def _surface_properties(corners: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Compute the area, the centroid, and the inertia matrix about the centroid of triangles (f, 3, 3).

    The inertia is that of unit mass per area.
    """
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    area = float(areas.sum())
    centre = (areas[:, None] * corners.sum(axis=1)).sum(axis=0) / (3.0 * area)
    return area, centre, _inertia(corners - centre, areas / 12.0)


def _solid_properties(corners: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Compute the volume, the centroid, and the inertia matrix about the centroid of a solid with unit density.

    The triangles (f, 3, 3) enclose the solid. The solid is the sum of the tetrahedra between the triangles and a common
    apex; the volume of a tetrahedron is negative if its triangle faces the apex.
    """
    volumes = tetrahedra(corners)
    volume = float(volumes.sum())
    if volume == 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centre = (volumes[:, None] * corners.sum(axis=1)).sum(axis=0) / (4.0 * volume)
    x = corners - centre
    return volume, centre, _inertia(x, tetrahedra(x) / 20.0)


def _inertia(x: FloatArray, weights: FloatArray) -> FloatArray:
    """Compute the inertia matrix about the origin of triangles, or of tetrahedra with the origin as a vertex.

    The integral of x x' over a simplex with vertices a, b, c is w (a a' + b b' + c c' + s s'), where s = a + b + c.

    Args:
        x: Vertices a, b, c of each simplex (f, 3, 3).
        weights: Weights w (f,): area/12 of a triangle, volume/20 of a tetrahedron.
    """
    x = np.concatenate([x, x.sum(axis=1, keepdims=True)], axis=1)
    second = np.einsum("f,fki,fkj->ij", weights, x, x)
    inertia: FloatArray = np.trace(second) * np.eye(3) - second
    return inertia
