"""Fingers that press and slide on meshes: the walk over neighbours beside trimesh, coal and PyBullet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.oracles.brute_force import perpendicular_feet, winding_number
from graspfx.bench.peers.mesh_peers import ByCoal, ByPyBullet, ByTrimesh, MeshPeer
from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.machine import compiled
from graspfx.compile.records import Many, Record, size_of
from graspfx.spatial import Vector
from graspfx.surfaces.triangles.mesh import new_fingers
from graspfx.surfaces.triangles.mesh_finger import MeshFinger
from graspfx.surfaces.triangles.mesh_tree import MeshTree
from graspfx.surfaces.triangles.tree import FloatArray, flatten
from graspfx.surfaces.triangles.walk import mesh_contact

TITLE = "Contact with meshes: five fingers that press and slide"
LIMITS = (
    "The time is that of a tick of five fingers along one smooth path; a finger that jumps costs more. The error is "
    "that of the way from finger to contact point (zero outside), the largest over the path: what times a gain is "
    "the force. On the sphere every contact point counts as right that a finger may be held by on the side that it "
    "came from, so that methods without a memory are right too; on the plate it is the one on the side that the "
    "finger came from. The peers take the side from the triangle of their nearest point, which is not in their "
    "time: that is the library's queries alone, called from Python. PyBullet is asked up to 20 480 triangles."
)

FINGERS = 5
RADIUS = 0.04  # of the sphere [m]
THICKNESS, DEEP = 0.001, 0.006  # of the plate, and how deep it is pressed [m]
TICKS = 64  # of a path, which then begins again
REACH = 0.002  # up to this gap our contact point is the nearest one [m]
EXACT = 1e-16  # that a double near the surface leaves open, relative to the size: 32 of them are ours
SLOW = 20_480  # triangles up to which PyBullet is asked

Way = NDArray[np.float64]
IntArray = NDArray[np.intp]


@dataclass(frozen=True)
class Path:
    """Five fingers on a surface.

    Attributes:
        points: (ticks, fingers, 3) [m].
        truth: for a tick and a finger, all ways (k, 3) from it to where it may be held; zero outside.
        ticks: those whose error is looked at.
    """

    vertices: FloatArray
    faces: IntArray
    points: FloatArray
    truth: Callable[[int, int], Any]
    ticks: Sequence[int]

    def error(self, ways: Sequence[Way]) -> float:
        """Find the largest distance [m] of the ways (fingers, 3) of the ticks from the nearest true one."""
        worst = 0.0
        for k, way in zip(self.ticks, ways, strict=True):
            for finger in range(FINGERS):
                off = self.truth(k, finger) - way[finger].astype(np.longdouble)
                worst = max(worst, float(np.sqrt((off * off).sum(axis=1)).min()))
        return worst


def cases(quick: bool) -> Iterator[Case]:
    """Yield spheres of growing numbers of triangles, then a plate of 1 mm that is pressed 6 mm deep."""
    for subdivisions in (1, 3) if quick else (1, 3, 5, 6):
        path = on_sphere(subdivisions, every=16 if quick else 4)
        yield Case("contact", f"sphere, {len(path.faces)} triangles", "m", methods(path))
    path = on_plate(1 if quick else 5)
    yield Case("contact", f"plate of 1 mm, {len(path.faces)} triangles", "m", methods(path))


def on_sphere(subdivisions: int, every: int) -> Path:
    """Lead fingers from 1 mm outside the corners to 5 mm inside and out again, while they slide by 8 mm to and fro."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
    vertices, faces = np.asarray(ball.vertices, dtype=np.float64), np.asarray(ball.faces, dtype=np.intp)
    rng = np.random.default_rng(0)
    u = rng.normal(size=(FINGERS, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    w = np.cross(u, rng.normal(size=(FINGERS, 3)))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    t = 2.0 * math.pi * (np.arange(TICKS) / TICKS)[:, None, None]
    angle = 0.2 * np.sin(t + np.arange(FINGERS)[:, None])
    points = (RADIUS + 0.001 - 0.006 * np.sin(0.5 * t) ** 2) * (np.cos(angle) * u + np.sin(angle) * w)
    corners = vertices[faces]
    middles = corners.mean(axis=1)
    size = float(np.linalg.norm(corners - middles[:, None], axis=2).max())

    def truth(k: int, finger: int) -> Any:
        p = points[k, finger]
        if winding_number(vertices, faces, p) < 0.5:
            return np.zeros((1, 3), dtype=np.longdouble)
        away = np.linalg.norm(middles - p, axis=1)
        near = faces[away <= away.min() + 2.0 * size]  # all others are further away than one of these
        return perpendicular_feet(vertices, near, p, EXACT * RADIUS) - p

    return Path(vertices, faces, points, truth, range(0, TICKS, every))


def on_plate(subdivisions: int) -> Path:
    """Lead fingers from 1 mm outside to 6 mm behind the surface, from both sides, sliding at 0.5 mm a tick."""
    import trimesh

    box = trimesh.creation.box(extents=(0.1, 0.08, THICKNESS))
    for _ in range(subdivisions):
        box = box.subdivide()
    vertices, faces = np.asarray(box.vertices, dtype=np.float64), np.asarray(box.faces, dtype=np.intp)
    t = 2.0 * math.pi * np.arange(TICKS) / TICKS
    depth = (DEEP + 0.001) * np.sin(0.5 * t) ** 2 - 0.001
    points = np.empty((TICKS, FINGERS, 3))
    for finger in range(FINGERS):
        up = 1.0 if finger % 2 == 0 else -1.0
        points[:, finger, 0] = 0.015 * (finger - 2) + 0.005 * np.sin(t)
        points[:, finger, 1] = 0.01 * np.cos(t + finger)
        points[:, finger, 2] = up * (0.5 * THICKNESS - depth)

    def truth(k: int, finger: int) -> Any:
        z = 0.5 * THICKNESS * (1.0 if finger % 2 == 0 else -1.0)
        way = np.longdouble(z) - points[k, finger, 2]
        return np.array([[0.0, 0.0, max(way * np.sign(z), 0.0) * np.sign(z)]], dtype=np.longdouble)

    return Path(vertices, faces, points, truth, range(TICKS))


def methods(path: Path) -> list[Method]:
    """List GraspFX and the peers on one path; an operation is a tick of five fingers."""
    entries = ours(path)
    for name, package, make in (
        ("trimesh", "rtree", ByTrimesh),
        ("coal", "coal", ByCoal),
        ("PyBullet, concave", "pybullet", lambda v, f: ByPyBullet(v, f, concave=True)),
        ("PyBullet, hull", "pybullet", lambda v, f: ByPyBullet(v, f, concave=False)),
    ):
        if package == "pybullet" and len(path.faces) > SLOW:
            continue
        entries.append(peer(name, path, make) if is_installed(package) else missing(name, package))
    return entries


def peer(name: str, path: Path, make: Callable[[FloatArray, IntArray], MeshPeer]) -> Method:
    """Ask a library tick by tick."""
    surface = make(path.vertices, path.faces)

    def call() -> None:
        for points in path.points:
            surface.ask(points)

    def error() -> float:
        return path.error([surface.read(surface.ask(path.points[k])) for k in path.ticks])

    return Method(name, call, error, calls=TICKS)


def ours(path: Path) -> list[Method]:
    """Walk on the mesh: interpreted; compiled with a call for each tick; and compiled with one call for all of them."""
    bound = 32.0 * EXACT * float(np.ptp(path.vertices, axis=0).max())
    one = _method("GraspFX, interpreted", path, source_function(fingers_on_mesh), memoryview, 1, bound)
    if not is_installed("llvmlite"):
        return [missing("GraspFX, compiled", "llvmlite"), one]
    run = compiled(fingers_on_mesh)
    return [
        _method("GraspFX, compiled", path, run, np.asarray, 1, bound),
        _method("GraspFX, compiled, one call", path, run, np.asarray, TICKS, bound),
        one,
    ]


def _method(
    name: str,
    path: Path,
    run: Callable[..., None],
    view: Callable[[FloatArray], Any],
    ticks: int,
    bound: float,
) -> Method:
    answers = np.zeros(TICKS * FINGERS * size_of(Answer))
    M = view(flatten(path.vertices, path.faces, closed=True))
    S, P, out = view(new_fingers(FINGERS, REACH).reshape(-1)), view(path.points.ravel()), view(answers)
    fingers = S, 0, size_of(MeshFinger), FINGERS
    places, rows = (P, 0, size_of(Place), TICKS * FINGERS), (out, 0, size_of(Answer), TICKS * FINGERS)

    def call() -> None:
        for k in range(0, TICKS, ticks):
            run(M, 0, *fingers, *places, *rows, k, ticks)

    def error() -> float:
        call()
        contacts = answers.reshape(TICKS, FINGERS, 7)
        touching = contacts[:, :, 6:] < 0.0
        ways = np.where(touching, contacts[:, :, :3] - path.points, 0.0)
        return path.error([ways[k] for k in path.ticks])

    return Method(name, call, error, calls=TICKS, bound=bound)


class Place(Record):
    """Where a finger is at a tick."""

    position: Vector


class Answer(Record):
    """The contact of a finger at a tick."""

    point: Vector
    normal: Vector
    gap: float


@kernel
def fingers_on_mesh(
    mesh: MeshTree, fingers: Many[MeshFinger], places: Many[Place], answers: Many[Answer], first: int, ticks: int
) -> None:
    """Find the contacts of all fingers at their places in some ticks."""
    count = fingers.count
    for k in range(first * count, (first + ticks) * count):
        place, answer = places[k], answers[k]
        contact = mesh_contact(mesh, fingers[k % count], place.position)
        answer.point, answer.normal, answer.gap = contact.point, contact.normal, contact.gap
