"""Rigid bodies in one PyBullet world, where they touch obstacles and one another."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from graspfx.compile.memory import zeros
from graspfx.compile.records import numbers
from graspfx.cones.cone import contact_frame
from graspfx.errors import InputError
from graspfx.objects import guest
from graspfx.objects import integrators as at
from graspfx.objects.body import FloatArray
from graspfx.objects.bullet.bullet import BulletCarrier, BulletMember, new_client, pybullet
from graspfx.objects.floor.floor import FLAT_KINDS, hull_points, plane_of
from graspfx.objects.surroundings import Meeting, Member, Obstacle
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form import proxy

# Contact parameters with which bodies rest and grasps hold, as measured: docs/explanation/worlds.md.
ENGINE = {
    "numSolverIterations": 200,  # with 50 a box creeps by 1e-5 m in ten seconds
    "solverResidualThreshold": 0.0,  # otherwise the solver stops before friction has converged
    "contactBreakingThreshold": 0.005,  # [m]
    "contactSlop": 0.0,  # otherwise a body sinks by 10 um
    "erp": 0.2,  # share of a penetration that is removed in a step; it adds to the speed of a bounce
    "contactERP": 0.2,
    "frictionERP": 0.2,
    "deterministicOverlappingPairs": 1,
}
SLAB = 200.0  # edge of the box that represents a floor to boxes [m]
MARGIN = 1e-5  # radius by which PyBullet rounds a hull [m]
ELLIPSOID_POINTS = 2000  # number of points of the ellipsoid's hull, which lies up to 1/1000 of its size inside it


class BulletWorld(BulletCarrier):
    """Bodies and obstacles in one PyBullet world.

    Args:
        members: Bodies, as blocks filled by `fill_body` with shapes. The degrees of freedom of a body with a shape are
            either all free or all locked.
        obstacles: Fixed shapes, including concave meshes.
        meeting: Friction and restitution of all pairs of shapes, and whether the bodies collide with one another.

    Raises:
        MissingPackageError: If PyBullet is not installed.
        InputError: If the world is not in three dimensions, a shape is unbounded, or some but not all degrees of
            freedom of a body with a shape are free.
    """

    def __init__(self, members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> None:
        for member in members:
            _require_whole(member)
        self._bullet = bullet = pybullet()
        self.client = client = new_client()
        self._disconnect = weakref.finalize(self, bullet.disconnect, client)
        bullet.setPhysicsEngineParameter(**ENGINE, physicsClientId=client)
        self._members = members
        buffer = zeros(len(members) * guest.SIZE)
        parts = buffer.reshape(-1, guest.SIZE)
        self.carried = [
            BulletMember(m.state, part, client, self._collision(m.shape, fixed=False))
            for m, part in zip(members, parts, strict=True)
        ]
        super().__init__(buffer, self.carried, client)
        fixed = [body for obstacle in obstacles for body in self._place_obstacle(obstacle)]
        for body in [*(carried.body for carried in self.carried), *fixed]:
            bullet.changeDynamics(
                body,
                -1,
                lateralFriction=math.sqrt(meeting.friction),  # PyBullet multiplies the values of a pair
                restitution=math.sqrt(meeting.restitution),
                spinningFriction=0.0,
                rollingFriction=0.0,
                collisionMargin=MARGIN,
                activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
                physicsClientId=client,
            )
        if not meeting.collide:
            for i, one in enumerate(self.carried):
                for other in self.carried[:i]:
                    bullet.setCollisionFilterPair(one.body, other.body, -1, -1, 0, physicsClientId=client)

    def contact_wrench(self, number: int) -> FloatArray:
        """Return force and moment (about the body's centre) of all contacts of a body in the last step, (6,) [N, N m].

        Args:
            number: Index of the body among the members.
        """
        total = np.zeros(6)
        body = self.carried[number].body
        centre = self._members[number].state[at.POSITION : at.POSITION + 3]
        # read all contacts: for a single body PyBullet may exchange a pair and not the sign of its friction
        for point in self._bullet.getContactPoints(physicsClientId=self.client):
            if body not in point[1:3]:
                continue
            sign, place = (1.0, point[5]) if point[1] == body else (-1.0, point[6])
            friction = point[10] * np.array(point[11]) + point[12] * np.array(point[13])
            force = sign * (point[9] * np.array(point[7]) + friction)
            total[:3] += force
            total[3:] += np.cross(np.array(place) - centre, force)
        return total

    def _place_obstacle(self, obstacle: Obstacle) -> Iterator[int]:
        """Create the fixed PyBullet bodies of an obstacle, and yield their indices.

        For a plane, there is one body for each side on which members are. Members that are boxes get another body, a
        large box. All corners of a member on this box touch it in the same step. On PyBullet's plane they touch one per
        step, which rotates the member, so that its path deviates by up to 20 degrees. Members of other shapes rest
        better on PyBullet's plane.
        """
        kind = getattr(obstacle.shape, "kind", None)
        if kind not in (proxy.HALF_SPACE, proxy.PLANE):
            yield self._fixed(self._collision(obstacle.shape, fixed=True), obstacle.position, obstacle.rotation)
            return
        places = [member.state[at.POSITION : at.POSITION + 3] for member in self._members]
        normals = [plane_of(obstacle, place)[0] for place in places]
        boxes = [getattr(member.shape, "kind", None) == proxy.BOX for member in self._members]
        for normal, is_box in {(*n.tolist(), box): (n, box) for n, box in zip(normals, boxes, strict=True)}.values():
            frame = contact_frame(Vector(*normal.tolist()), 3)
            n, first, second = np.reshape(list(numbers(frame)), (3, 3))
            face, place = self._create_shape("GEOM_PLANE", planeNormal=[0.0, 0.0, 1.0]), obstacle.position
            if is_box:
                face, place = self._create_shape("GEOM_BOX", halfExtents=[0.5 * SLAB] * 3), place - 0.5 * SLAB * n
            body = self._fixed(face, place, np.stack([first, second, n], axis=1))
            for carried, own, box in zip(self.carried, normals, boxes, strict=True):
                if box != is_box or own @ normal < 0.0:
                    self._bullet.setCollisionFilterPair(carried.body, body, -1, -1, 0, physicsClientId=self.client)
            yield body

    def _fixed(self, collision: int, position: FloatArray, rotation: FloatArray) -> int:
        body: int = self._bullet.createMultiBody(
            baseMass=0.0,
            baseCollisionShapeIndex=collision,
            basePosition=position.tolist(),
            baseOrientation=_quaternion(rotation),
            useMaximalCoordinates=1,
            physicsClientId=self.client,
        )
        return body

    def _create_shape(self, geometry: str, **sizes: Any) -> int:
        number: int = self._bullet.createCollisionShape(
            getattr(self._bullet, geometry), **sizes, physicsClientId=self.client
        )
        return number

    def _collision(self, shape: Any, *, fixed: bool) -> int:
        """Create a collision shape and return PyBullet's index of it; -1 if `shape` is None.

        Meshes are passed as points, because PyBullet caches mesh files.

        Raises:
            InputError: If the shape is a plane or half-space, or PyBullet has no such shape.
        """
        if shape is None:
            return -1
        if hasattr(shape, "vertices"):
            if fixed:
                return self._create_shape(
                    "GEOM_MESH",
                    vertices=shape.vertices.tolist(),
                    indices=shape.faces.ravel().tolist(),
                    flags=self._bullet.GEOM_FORCE_CONCAVE_TRIMESH,
                )
            return self._create_shape("GEOM_MESH", vertices=hull_points(shape.vertices).tolist())
        if shape.kind in FLAT_KINDS:
            raise InputError("shape", shape, "a bounded shape", "make it an obstacle")
        a, b, c = shape.parameters
        if shape.kind == proxy.BOX:
            return self._create_shape("GEOM_BOX", halfExtents=[a, b, c])
        if shape.kind == proxy.SPHERE:
            return self._create_shape("GEOM_SPHERE", radius=a)
        if shape.kind == proxy.CAPSULE:
            return self._create_shape("GEOM_CAPSULE", radius=a, height=2.0 * b)
        if shape.kind == proxy.CYLINDER:
            return self._create_shape("GEOM_CYLINDER", radius=a, height=2.0 * b)
        if shape.kind == proxy.ELLIPSOID:
            return self._create_shape("GEOM_MESH", vertices=(ellipsoid_points(ELLIPSOID_POINTS) * [a, b, c]).tolist())
        raise InputError(
            "shape", shape, "a shape that PyBullet supports", "add it to `_collision`, or use other dynamics"
        )


def ellipsoid_points(count: int) -> FloatArray:
    """Return points on the unit sphere at nearly equal distances, along a Fibonacci spiral, (count, 3)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = math.pi * (3.0 - math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    points: FloatArray = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return points


def _require_whole(member: Member) -> None:
    free = member.state[at.FREE : at.FREE + 6]
    if member.state[at.DIMENSIONS] != 3.0:
        raise InputError(
            "dimensions", int(member.state[at.DIMENSIONS]), "3: a PyBullet world is in space", "use native dynamics"
        )
    if member.shape is not None and free.any() and not free.all():
        raise InputError("free", free.tolist(), "all or none for a body with contacts", "use native dynamics")


def _quaternion(R: FloatArray) -> tuple[float, ...]:
    """Convert a rotation matrix to a unit quaternion (x, y, z, w)."""
    x, y, z = np.diag(R)
    trace = np.array([x - y - z, y - x - z, z - x - y, x + y + z])
    k = int(trace.argmax())
    rows = np.array(
        [
            [1.0 + trace[0], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[0, 1] + R[1, 0], 1.0 + trace[1], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1.0 + trace[2], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace[3]],
        ]
    )
    q = rows[k] / np.linalg.norm(rows[k])
    return tuple(q.tolist())
