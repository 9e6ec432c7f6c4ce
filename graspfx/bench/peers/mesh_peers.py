"""Fingers on a mesh by trimesh, coal and PyBullet: the nearest point of the surface, and the side from its triangle.

Each has `ask(points)`, which is what is timed, the library's queries alone, and `read(answers)`, which makes of them
where the fingers are drawn to, (n, 3): the way from each finger to the surface if it is inside, else zero [m].
"""

from __future__ import annotations

import weakref
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.objects.bullet.bullet import new_client, pybullet
from graspfx.surfaces.triangles.tree import FloatArray, IntArray, face_normals

REACH = 0.02  # how far PyBullet looks for a surface [m]


class MeshPeer(Protocol):
    """One way to ask where fingers touch a mesh."""

    def ask(self, points: FloatArray) -> Any: ...

    def read(self, answers: Any) -> FloatArray: ...


class ByTrimesh:
    """`closest_point`, over an R-tree of the triangles."""

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        import_module("rtree")
        trimesh = import_module("trimesh")
        self._mesh = trimesh.Trimesh(vertices=vertices, faces=faces, process=False)
        self._normals = face_normals(vertices[faces])
        self._closest: Any = trimesh.proximity.closest_point

    def ask(self, points: FloatArray) -> tuple[FloatArray, Any]:
        return points, self._closest(self._mesh, points)

    def read(self, answers: Any) -> FloatArray:
        points, (nearest, _, triangles) = answers
        return drawn(nearest - points, self._normals[triangles])


class ByCoal:
    """Distance from a hierarchy of boxes (OBBRSS) to a sphere without radius."""

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        coal: Any = import_module("coal")
        self._model = coal.BVHModelOBBRSS()
        self._model.beginModel(len(faces), len(vertices))
        self._model.addVertices(vertices)
        self._model.addTriangles(faces)
        self._model.endModel()
        self._normals = face_normals(vertices[faces])
        self._point = coal.Sphere(0.0)  # kept: what asks for the distance does not own it
        self._distance = coal.ComputeDistance(self._model, self._point)
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._still, self._place = coal.Transform3s.Identity(), coal.Transform3s.Identity()

    def ask(self, points: FloatArray) -> list[tuple[FloatArray, Any, int]]:
        result, place = self._result, self._place
        answers = []
        for p in points:
            place.setTranslation(p)
            result.clear()
            self._distance(self._still, place, self._request, result)
            answers.append((p, result.getNearestPoint1().copy(), result.b1))
        return answers

    def read(self, answers: Any) -> FloatArray:
        points, nearest, triangles = (np.array(each) for each in zip(*answers, strict=True))
        return drawn(nearest - points, self._normals[triangles])


class ByPyBullet:
    """`getClosestPoints` of a small sphere and the mesh, as it is (concave) or as the hull of its vertices."""

    RADIUS = 1e-6  # of the sphere [m]

    def __init__(self, vertices: FloatArray, faces: IntArray, *, concave: bool) -> None:
        self._bullet = bullet = pybullet()
        self._client = client = new_client()
        weakref.finalize(self, bullet.disconnect, client)
        shape: dict[str, Any] = {"vertices": vertices.tolist()}
        if concave:
            shape |= {"indices": faces.ravel().tolist(), "flags": bullet.GEOM_FORCE_CONCAVE_TRIMESH}
        mesh = bullet.createCollisionShape(bullet.GEOM_MESH, physicsClientId=client, **shape)
        ball = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=self.RADIUS, physicsClientId=client)
        self._mesh = bullet.createMultiBody(0.0, mesh, physicsClientId=client)
        self._ball = bullet.createMultiBody(1.0, ball, physicsClientId=client)

    def ask(self, points: FloatArray) -> list[Any]:
        bullet, client, ball = self._bullet, self._client, self._ball
        answers = []
        for p in points:
            bullet.resetBasePositionAndOrientation(ball, p, (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
            answers.append(bullet.getClosestPoints(ball, self._mesh, REACH, physicsClientId=client))
        return answers

    def read(self, answers: Any) -> FloatArray:
        """Read the nearest of PyBullet's points: its normal is from the mesh to the sphere, its gap signed."""
        ways = np.zeros((len(answers), 3))
        for way, answer in zip(ways, answers, strict=True):
            if answer:
                normal, gap = min(((point[7], point[8]) for point in answer), key=lambda each: each[1])
                way[:] = max(0.0, -gap - self.RADIUS) * np.array(normal)
        return ways


def drawn(ways: FloatArray, outward: NDArray[np.float64]) -> FloatArray:
    """Give the ways (n, 3) to the surface of fingers that are behind their triangle, zero for the others."""
    inside = (ways * outward).sum(axis=1) > 0.0
    return np.where(inside[:, None], ways, 0.0)
