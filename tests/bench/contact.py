"""Fingers that press and slide on meshes: whole ticks beside the queries of trimesh, coal and PyBullet."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed
from graspfx.objects.bullet.bullet import pybullet
from tests.bench.peers import imported
from tests.support.brute_force import perpendicular_feet, winding_number

FloatArray = NDArray[np.float64]

TITLE = "Contact with meshes: five fingers that press and slide"
LIMITS = """
The time of GraspFX is that of a whole tick of `session.step`, with devices, coupling, object and a recorded row; that
of the peers covers their library's queries only, called from Python at the positions of the fingers. The error is the
largest error, over the run, of the displacement from finger to contact point (zero outside), which is multiplied by a
gain to obtain the force. On the sphere every contact point that may hold a finger is accepted, so that methods without
a memory are also correct; on the plate it must be on the side from which the finger came. The peers take the side from
the triangle of the nearest point. PyBullet is measured up to 2000 triangles.
"""

RADIUS, THICKNESS = 0.04, 0.001  # of the sphere, of the plate [m]
PERIOD, TICKS, EVERY = 0.001, 1000, 20  # [s], ticks of a run, and from one that is checked to the next
STIFFNESS = 200.0  # of coupling and hands [N/m]
EXACT = 1e-16  # that a double near the surface leaves open, relative to the size
SLOW = 2000  # triangles up to which PyBullet is asked
REACH = 0.02  # how far PyBullet looks for a surface [m]


@dataclass(frozen=True)
class Pressed:
    """Five fingers with hands of their own on a mesh that does not move.

    Attributes:
        starts, ups: where each finger is at first, outside, and the direction out of the object (5, 3).
        truth: all ways (k, 3) from a place of a finger to where it may be held; zero outside.
        deep: how deep hands pull [m].
    """

    vertices: FloatArray
    faces: NDArray[np.intp]
    starts: FloatArray
    ups: FloatArray
    truth: Callable[[FloatArray, int], Any]
    deep: float

    @cached_property
    def scene(self) -> gx.Scene:
        """The scene: hands pull the fingers to and fro, `deep` behind the surface and sideways."""
        aside = np.cross(self.ups, [0.3, -0.5, 0.8])
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        return gx.Scene(
            dimensions=3, period=PERIOD, duration=TICKS * PERIOD,
            engine="compiled" if is_installed("llvmlite") else "interpreted",
            object={"mass": 1.0, "inertia": [1e-3] * 3, "viscosity": 1.0, "free": [False] * 6,
                    "shape": {"vertices": self.vertices.tolist(), "faces": self.faces.tolist()}},
            coupling={"external": {"stiffness": STIFFNESS}, "internal": {"stiffness": STIFFNESS}, "friction": 0},
            finger=[
                {
                    "device": {"name": "simulated", "mass": 0.1, "damping": 8.0}, "start": start.tolist(),
                    "hand": {"stiffness": 10.0 * STIFFNESS, "rest": (start - self.deep * up).tolist(),
                             "motion": {"kind": "sine", "amplitude": 0.008, "frequency": 1.5, "axis": side.tolist()}},
                }
                for start, up, side in zip(self.starts, self.ups, aside, strict=True)
            ],
        )  # fmt: skip

    @cached_property
    def recording(self) -> gx.Recording:
        return gx.run(self.scene)

    @cached_property
    def places(self) -> FloatArray:
        """Where the fingers were in the ticks that are checked, (N, 5, 3) [m]."""
        return np.asarray(self.recording.finger_position[::EVERY])

    def error(self, ways: FloatArray) -> float:
        """Find the largest distance [m] of ways (N, 5, 3) from the nearest true one."""
        worst = 0.0
        for places, own in zip(self.places, ways, strict=True):
            for finger, (p, way) in enumerate(zip(places, own, strict=True)):
                off = self.truth(p, finger) - way.astype(np.longdouble)
                worst = max(worst, float(np.sqrt((off * off).sum(axis=1)).min()))
        return worst


def cases(quick: bool) -> Iterator[Case]:
    """Yield spheres of growing numbers of triangles, then a plate of 1 mm that is pressed 6 mm deep."""
    for subdivisions in (2,) if quick else (2, 5):
        pressed = on_sphere(subdivisions)
        yield Case("contact", f"sphere, {len(pressed.faces)} triangles", "m", list(methods(pressed)))
    pressed = on_plate(1 if quick else 3)
    yield Case("contact", f"plate of 1 mm, {len(pressed.faces)} triangles", "m", list(methods(pressed)))


def methods(pressed: Pressed) -> Iterator[Method]:
    """List ours and the peers; an operation is five fingers in one tick."""
    session = gx.open(pressed.scene)
    yield Method("GraspFX, whole tick", partial(session.step, TICKS), lambda: pressed.error(ways(pressed)), calls=TICKS)
    peers: dict[str, Callable[[FloatArray, NDArray[np.intp]], MeshPeer]] = {"trimesh": ByTrimesh, "coal": ByCoal}
    if len(pressed.faces) <= SLOW:
        peers["PyBullet"] = ByPyBullet
    for name, make in peers.items():
        yield peer(name, make, pressed)


def ways(pressed: Pressed) -> FloatArray:
    """Read the ways from the fingers to their contact points, zero for those that do not touch."""
    contacts, touching = pressed.recording.contact_position[::EVERY], pressed.recording.touching[::EVERY]
    return np.where(touching[:, :, None], contacts - pressed.places, 0.0)


def peer(name: str, make: Callable[[FloatArray, NDArray[np.intp]], MeshPeer], pressed: Pressed) -> Method:
    """Ask a library tick by tick."""
    made: list[MeshPeer] = []

    def answers() -> list[Any]:
        if not made:
            made.append(make(pressed.vertices, pressed.faces))
        return [made[0].ask(points) for points in pressed.places]

    def error() -> float:
        return pressed.error(np.array([made[0].read(each) for each in answers()]))

    return Method(name, answers, error, calls=len(pressed.places))


def on_sphere(subdivisions: int) -> Pressed:
    """Press five fingers 5 mm into an icosphere."""
    trimesh = imported("trimesh", "the mesh")
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
    vertices, faces = np.asarray(ball.vertices, dtype=np.float64), np.asarray(ball.faces, dtype=np.intp)
    ups = np.random.default_rng(0).normal(size=(5, 3))
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    corners = vertices[faces]
    middles = corners.mean(axis=1)
    size = float(np.linalg.norm(corners - middles[:, None], axis=2).max())

    def truth(p: FloatArray, finger: int) -> Any:
        if winding_number(vertices, faces, p) < 0.5:
            return np.zeros((1, 3), dtype=np.longdouble)
        away = np.linalg.norm(middles - p, axis=1)
        near = faces[away <= away.min() + 2.0 * size]  # all others are further away than one of these
        return perpendicular_feet(vertices, near, p, EXACT * RADIUS) - p

    return Pressed(vertices, faces, (RADIUS + 0.001) * ups, ups, truth, 0.006)


def on_plate(subdivisions: int) -> Pressed:
    """Press five fingers 6 mm into a plate of 1 mm, from both sides."""
    trimesh = imported("trimesh", "the mesh")
    box = trimesh.creation.box(extents=(0.12, 0.1, THICKNESS))
    for _ in range(subdivisions):
        box = box.subdivide()
    vertices, faces = np.asarray(box.vertices, dtype=np.float64), np.asarray(box.faces, dtype=np.intp)
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    starts = np.stack([0.015 * (np.arange(5) - 2.0), 0.01 * np.cos(np.arange(5)), signs * (0.5 * THICKNESS + 0.001)], 1)

    def truth(p: FloatArray, finger: int) -> Any:
        depth = np.longdouble(0.5 * THICKNESS) - signs[finger] * np.longdouble(p[2])
        return np.array([[0.0, 0.0, max(depth, np.longdouble(0.0)) * signs[finger]]], dtype=np.longdouble)

    return Pressed(vertices, faces, starts, signs[:, None] * np.eye(3)[2], truth, 0.008)


class MeshPeer(Protocol):
    """One way to ask where fingers touch a mesh: `ask` is timed, the library's queries alone."""

    def ask(self, points: FloatArray) -> Any: ...

    def read(self, answers: Any) -> FloatArray:
        """Give the ways (n, 3) from fingers inside to the surface, zero for the others [m]."""
        ...


def drawn(points: FloatArray, nearest: FloatArray, corners: FloatArray) -> FloatArray:
    """Give the ways to the nearest points of fingers that are behind the triangles (n, 3, 3) of these."""
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside = ((nearest - points) * outward).sum(axis=1) > 0.0
    return np.where(inside[:, None], nearest - points, 0.0)


class ByTrimesh:
    """`closest_point`, over an R-tree of the triangles."""

    def __init__(self, vertices: FloatArray, faces: NDArray[np.intp]) -> None:
        imported("rtree", "the peer of trimesh")
        trimesh = imported("trimesh", "the peer of trimesh")
        self._mesh, self._corners = trimesh.Trimesh(vertices=vertices, faces=faces, process=False), vertices[faces]
        self._closest = trimesh.proximity.closest_point

    def ask(self, points: FloatArray) -> Any:
        return points, self._closest(self._mesh, points)

    def read(self, answers: Any) -> FloatArray:
        points, (nearest, _, triangles) = answers
        return drawn(points, nearest, self._corners[triangles])


class ByCoal:
    """Distance from a hierarchy of boxes (OBBRSS) to a sphere without radius."""

    def __init__(self, vertices: FloatArray, faces: NDArray[np.intp]) -> None:
        coal = imported("coal", "the peer of coal")
        self._corners = vertices[faces]
        self._model = coal.BVHModelOBBRSS()
        self._model.beginModel(len(faces), len(vertices))
        self._model.addVertices(vertices)
        self._model.addTriangles(faces)
        self._model.endModel()
        self._point = coal.Sphere(0.0)  # kept: what asks for the distance does not own it
        self._distance = coal.ComputeDistance(self._model, self._point)
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._still, self._place = coal.Transform3s.Identity(), coal.Transform3s.Identity()

    def ask(self, points: FloatArray) -> Any:
        result, place, answers = self._result, self._place, []
        for p in points:
            place.setTranslation(p)
            result.clear()
            self._distance(self._still, place, self._request, result)
            answers.append((p, result.getNearestPoint1().copy(), result.b1))
        return answers

    def read(self, answers: Any) -> FloatArray:
        points, nearest, triangles = (np.array(each) for each in zip(*answers, strict=True))
        return drawn(points, nearest, self._corners[triangles])


class ByPyBullet:
    """`getClosestPoints` of a small sphere and the mesh as it is, concave."""

    RADIUS = 1e-6  # of the sphere [m]

    def __init__(self, vertices: FloatArray, faces: NDArray[np.intp]) -> None:
        self._bullet = bullet = pybullet()
        self._client = client = bullet.connect(bullet.DIRECT)
        weakref.finalize(self, bullet.disconnect, client)
        mesh = bullet.createCollisionShape(
            bullet.GEOM_MESH, vertices=vertices.tolist(), indices=faces.ravel().tolist(),
            flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH, physicsClientId=client,
        )  # fmt: skip
        ball = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=self.RADIUS, physicsClientId=client)
        self._mesh = bullet.createMultiBody(0.0, mesh, physicsClientId=client)
        self._ball = bullet.createMultiBody(1.0, ball, physicsClientId=client)

    def ask(self, points: FloatArray) -> Any:
        bullet, client, ball, answers = self._bullet, self._client, self._ball, []
        for p in points:
            bullet.resetBasePositionAndOrientation(ball, p, (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
            answers.append(bullet.getClosestPoints(ball, self._mesh, REACH, physicsClientId=client))
        return answers

    def read(self, answers: Sequence[Any]) -> FloatArray:
        """Read the nearest of PyBullet's points: its normal is from the mesh to the sphere, its gap signed."""
        found = np.zeros((len(answers), 3))
        for way, answer in zip(found, answers, strict=True):
            if answer:
                normal, gap = min(((point[7], point[8]) for point in answer), key=lambda each: each[1])
                way[:] = max(0.0, -gap - self.RADIUS) * np.array(normal)
        return found
