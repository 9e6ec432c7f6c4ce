"""A native body that rests, slides and rolls on fixed planes, such as floors and walls, with Coulomb friction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx import elementary, installed
from graspfx.compile.kernel import kernel
from graspfx.compile.memory import zeros
from graspfx.compile.records import Many, size_for, size_of, start_of
from graspfx.compile.value_cache import through_cache
from graspfx.cones.cone import contact_frame
from graspfx.cones.problem import problem_size, set_up
from graspfx.errors import GraspFXError, InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import FloatArray, NativeBody
from graspfx.objects.body_state import BodyState
from graspfx.objects.floor import rest
from graspfx.objects.floor.planes import BALL, ELLIPSOID, MOST, NOTCH, RIM, SIDES, Feature, FloorState, lowest
from graspfx.objects.surroundings import Meeting, Member, Obstacle
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form import proxy

OTHERS = "use bullet or mujoco"  # advice for what a floor does not support
SHEET = 1e-9  # ratio of thickness to width below which a mesh is flat, and Qhull finds no volume
FLAT_KINDS = (proxy.HALF_SPACE, proxy.PLANE)


@kernel
def advance(body: BodyState, floor: FloorState, T: float) -> int:
    """Move the body on its planes by T [s] and return 0; if the forces do not converge, do not move it and return 1."""
    return 1 if rest.step_on_planes(body, floor, T) < 0 else 0


@kernel
def expect(body: BodyState, floor: FloorState, T: float) -> None:
    """Predict the motion over T [s] under the planes' forces of the last sample, without a wrench of the fingers."""
    at.predict(body, T)
    if floor.touching != 0:
        rest.predict_on_planes(body, floor, T)


class FloorBody(NativeBody):
    """A rigid body in contact with half-spaces and planes; `objects.floor.rest` defines the contact law.

    The damping of a contact is b = 2 sqrt(k m) for a stiffness k and the body's mass m. No motion of the body is then
    underdamped, so that the body does not bounce.

    Args:
        member: Block and shape of the body.
        obstacles: Half-spaces and planes. A plane keeps the body on the side on which its centre is at the start.
        meeting: Friction and stiffness of the contacts.

    Raises:
        InputError: If an obstacle is neither a half-space nor a plane, if the body's shape is unbounded or not
            supported, or if the restitution is not zero.
    """

    stepping = staticmethod(advance)
    predicting = staticmethod(expect)
    declaration = FloorState
    buffer: FloatArray

    def __init__(self, member: Member, obstacles: Sequence[Obstacle], meeting: Meeting) -> None:
        super().__init__(member.state)
        if meeting.restitution != 0.0:
            raise InputError("restitution", meeting.restitution, "0, because a native body does not bounce", OTHERS)
        points = features(member.shape, self.dimensions)
        planes = [plane_of(obstacle, self.state[at.POSITION : at.POSITION + 3]) for obstacle in obstacles]
        sizes = {"plane_count": len(planes), "feature_count": len(points)}
        most = len(planes) * MOST + len(points)  # largest number of contacts
        room = problem_size(most)
        self.buffer = zeros(size_for(FloorState, **sizes, problem_entries=room))
        floor = self._floor = FloorState(memoryview(self.buffer))
        floor.plane_count, floor.feature_count, floor.problem_entries = len(planes), len(points), room
        self.buffer[start_of(FloorState, "problem")] = problem = floor.problem_room.offset
        set_up(self.buffer, problem, most).count = 0
        floor.stiffness, floor.friction, floor.reach = meeting.stiffness, meeting.friction, reach(points)
        floor.damping = 2.0 * math.sqrt(meeting.stiffness * self._body.mass)
        for plane, (normal, distance) in zip(floor.planes, planes, strict=True):
            plane.frame = contact_frame(Vector(*normal.tolist()), max(self.dimensions, 2))
            plane.distance = distance
        first = floor.features.offset
        self.buffer[first : first + points.size] = points.ravel()
        self._wrench = self.buffer[start_of(FloorState, "force") : start_of(FloorState, "unknowns")]

    @property
    def contact_wrench(self) -> FloatArray:
        """Force and moment (about the body's centre) of all planes in the last sample, in world axes, (6,) [N, N m]."""
        return self._wrench

    @property
    def touching(self) -> int:
        """Number of contact points that bore a force in the last sample."""
        return self._floor.touching

    @property
    def associated(self) -> int:
        """Number of samples that used the associated friction law, because Coulomb's law had no known solution."""
        return self._floor.associated

    def adopt(self, other: FloorBody) -> None:
        """Use the contact damping of another body on the same planes, which was computed from that body's mass."""
        self._floor.damping = other._floor.damping

    def step(self, T: float) -> None:
        """Move the body by T [s] under the wrench in the block and the planes' forces, constant over the sample.

        Raises:
            GraspFXError: If the contact forces did not converge.
        """
        code = advance(self._body, self._floor, T)
        if code:
            raise GraspFXError(self.fault_text(code))

    def fault_text(self, code: int) -> str:
        return (
            f"the contact forces between the object and its obstacles did not converge; shorten the period, or {OTHERS}"
        )

    def free_motion(self, T: float) -> None:
        """Fill the NEXT and COMPLIANCE entries for T [s] of motion under the last sample's contact forces.

        Raises:
            InputError: If the integrator is not "implicit". The entries would not describe a step of another
                integrator.
        """
        super().free_motion(T)
        expect(self._body, self._floor, T)


def plane_of(obstacle: Obstacle, seen_from: FloatArray) -> tuple[FloatArray, float]:
    """Return the plane's unit normal (3,) that points towards the body, and its distance from the origin along it [m].

    Args:
        obstacle: Half-space or plane.
        seen_from: Position of the body's centre, (3,) [m]; it selects the side of a plane.

    Raises:
        InputError: If the obstacle is neither a half-space nor a plane.
    """
    kind = getattr(obstacle.shape, "kind", None)
    if kind not in FLAT_KINDS:
        raise InputError(
            f"obstacle {obstacle.name}",
            obstacle.shape,
            "a half-space or a plane for native objects",
            OTHERS,
        )
    normal = obstacle.rotation @ np.array(obstacle.shape.parameters)
    if kind == proxy.PLANE and normal @ (seen_from - obstacle.position) < 0.0:
        normal = -normal
    return normal, float(normal @ obstacle.position)


def features(shape: Any, d: int) -> FloatArray:
    """List the features of a shape that can touch a plane, one per row, (features, 5).

    A row contains the kind, the position (3,) and the radius, as in `Feature`. The features are the corners of a box,
    the end spheres of a capsule, a whole sphere or ellipsoid, and the vertices of a mesh's convex hull. A cylinder has
    its two rims and, on each rim, eight fixed points on which the cylinder can stand.

    Raises:
        InputError: If the shape is unbounded, or shapes of its kind are not supported.
    """
    return np.array(list(_features(shape, d)), dtype=float).reshape(-1, size_of(Feature))


def _features(shape: Any, d: int) -> Iterator[tuple[float, ...]]:
    if hasattr(shape, "vertices"):
        for x, y, z in hull_points(shape.vertices):
            yield BALL, x, y, z, 0.0
        return
    a, b, c = shape.parameters
    if shape.kind in FLAT_KINDS:
        raise InputError(
            "shape", shape, "a bounded shape", "lock every degree of freedom of a floor, or make it an obstacle"
        )
    if shape.kind == proxy.SPHERE:
        yield BALL, 0.0, 0.0, 0.0, a
    elif shape.kind == proxy.BOX:
        for x in (-a, a):
            for y in (-b, b) if d > 1 else (0.0,):
                for z in (-c, c) if d > 2 else (0.0,):
                    yield BALL, x, y, z, 0.0
    elif shape.kind == proxy.CAPSULE:
        for end in (-b, b):
            yield (BALL, end, 0.0, 0.0, a) if d == 2 else (BALL, 0.0, 0.0, end, a)
    elif shape.kind == proxy.CYLINDER:
        for end in (-b, b):
            yield RIM, 0.0, 0.0, end, a
            for side in range(SIDES):
                angle = 2.0 * math.pi * side / SIDES
                yield NOTCH, a * elementary.cos(angle), a * elementary.sin(angle), end, 0.0
    elif shape.kind == proxy.ELLIPSOID:
        yield ELLIPSOID, a, b, c, 0.0
    else:
        raise InputError(
            "shape", shape, "a shape whose contact with planes is implemented", "add its features to `floor.features`"
        )


def reach(points: FloatArray) -> float:
    """Compute the largest distance of a point of the features from the body's centre [m]."""
    kinds, places = points[:, 0], np.linalg.norm(points[:, 1:4], axis=1)
    far = np.where(kinds == BALL, places + points[:, 4], places)
    far = np.where(kinds == RIM, np.hypot(points[:, 3], points[:, 4]), far)
    return float(np.where(kinds == ELLIPSOID, points[:, 1:4].max(axis=1), far).max())


def clearance(shape: Any, d: int, state: FloatArray, obstacle: Obstacle) -> float:
    """Compute the signed distance of a body from a half-space or plane, along the normal [m].

    The distance is that of the body's nearest point, and is negative if the body penetrates the surface.

    Args:
        shape: Shape of the body.
        d: Number of dimensions.
        state: Block of the body, (SIZE,).
        obstacle: Half-space or plane.
    """
    normal, distance = plane_of(obstacle, state[at.POSITION : at.POSITION + 3])
    body, n = BodyState(state), Vector(*normal.tolist())
    points = features(shape, d)
    own: Many[Feature] = Many(Feature, points.ravel(), 0, len(points))
    touches = [lowest(body, feature, n) for feature in own]
    height = float(normal @ state[at.POSITION : at.POSITION + 3]) - distance
    return height + min(float(normal @ np.array([arm.x, arm.y, arm.z])) for share, arm in touches if share)


# Convex hulls of meshes -----------------------------------------------------------------------------------------------


def hull_points(vertices: FloatArray) -> FloatArray:
    """Return the vertices on the convex hull of a mesh, (h, 3); for a flat mesh, those on the hull in its plane.

    The indices of these vertices are cached on disk, because importing scipy.spatial takes longer than most runs.
    """
    corners = np.ascontiguousarray(vertices, dtype=np.float64)
    points: FloatArray = vertices[_hull_vertices(corners.shape, corners.tobytes())]
    return points


@lru_cache(maxsize=8)
def _hull_vertices(shape: tuple[int, ...], entries: bytes) -> NDArray[np.intp]:
    """Load the indices of the vertices on the hull from the disk cache, or compute and store the indices."""
    settings = "hull", installed.version("scipy"), installed.version("numpy"), shape
    return through_cache(settings, entries, lambda: _hull(np.frombuffer(entries).reshape(shape)))


def _hull(vertices: FloatArray) -> NDArray[np.intp]:
    """Return the indices of the vertices on the convex hull, in ascending order."""
    from scipy.spatial import ConvexHull

    _, widths, axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    seen = vertices @ axes[:2].T if widths[2] <= SHEET * widths[0] else vertices
    return np.sort(ConvexHull(seen).vertices).astype(np.intp)
