"""Kernels of surfaces as they are written, run by Python itself, give the bits of the lowered ones."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.spatial import ZERO, Vector
from graspfx.surfaces.closed_form import proxy
from graspfx.surfaces.nearest import Nearest
from graspfx.surfaces.triangles import ball, walk
from graspfx.surfaces.triangles.mesh import STATE
from graspfx.surfaces.triangles.mesh_tree import TOUCHING, MeshFinger, MeshTree
from graspfx.surfaces.triangles.tree import FloatArray, flatten
from tests.support.meshes import SHAPES, plate
from tests.support.written import plain_python

SIZES = {
    proxy.BOX: Vector(0.03, 0.02, 0.01), proxy.SPHERE: Vector(0.03, 0.0, 0.0), proxy.HALF_SPACE: Vector(0.6, 0.0, 0.8),
    proxy.PLANE: Vector(0.0, 0.6, -0.8), proxy.CAPSULE: Vector(0.01, 0.03, 0.0),
    proxy.CYLINDER: Vector(0.03, 0.001, 0.0), proxy.ELLIPSOID: Vector(0.03, 0.01, 0.02),
}  # fmt: skip
LEAST = {proxy.CAPSULE: 2, proxy.CYLINDER: 3, proxy.ELLIPSOID: 2}  # dimensions
FACES = {proxy.BOX: 6, proxy.PLANE: 2, proxy.CAPSULE: 2, proxy.CYLINDER: 3, proxy.ELLIPSOID: 2}


def positions(rng: np.random.Generator, size: Vector, count: int) -> list[Vector]:
    """Inside, outside, on edges and axes, and with zeros of either sign."""
    half = np.array([size.x, size.y, size.z])
    p = rng.normal(size=(count, 3)) * 0.03
    at_edge = rng.random((count, 3)) < 0.2
    p = np.where(at_edge, half * rng.choice([-1.0, 1.0], (count, 3)), p)
    p = np.where(rng.random((count, 3)) < 0.2, rng.choice([0.0, -0.0], (count, 3)), p)
    return [Vector(*row) for row in p.tolist()]


@pytest.mark.parametrize("kind", SIZES)
def test_closed_forms(kind: int) -> None:
    """150 positions of point and ball, in each dimension that the shape has, from each face."""

    def contacts() -> list[str]:
        rng, found = np.random.default_rng(kind), list[str]()
        for p, last in zip(positions(rng, SIZES[kind], 150), positions(rng, ZERO, 150), strict=True):
            d = int(rng.integers(LEAST.get(kind, 1), 4))
            face = int(rng.integers(-1, FACES.get(kind, 1)))
            found.append(repr(proxy.closest_to_ball(kind, d, SIZES[kind], 0.001, p, face, last)))
        return found

    with plain_python():
        first = contacts()
    assert contacts() == first


def along(path: FloatArray, M: FloatArray, radius: float, reach: float) -> tuple[list[Nearest], FloatArray, int]:
    """Contacts along a path, the finger's block at its end, and how often it touches."""
    state = np.zeros(STATE)
    finger, mesh = MeshFinger(memoryview(state)), MeshTree(memoryview(M))
    finger.reach = reach
    contacts, touches = [], 0
    for row in path.tolist():
        g = Vector(*row)
        contacts.append(ball.ball_contact(mesh, finger, radius, g) if radius else walk.mesh_contact(mesh, finger, g))
        touches += finger.mode == TOUCHING
    return contacts, state, touches


def wandering(vertices: FloatArray, rng: np.random.Generator, steps: int) -> FloatArray:
    """From outside of a corner over creases and through walls, now and then onto a corner or an edge exactly."""
    p = 1.2 * vertices[rng.integers(len(vertices))]
    path = []
    for _ in range(steps):
        p = 0.97 * p + rng.normal(size=3) * rng.choice([1e-4, 2e-3])
        if rng.random() < 0.1:
            a, b = vertices[rng.integers(len(vertices), size=2)]
            p = a + rng.choice([0.0, 0.5]) * (b - a)
        path.append(p)
    return np.array(path)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("radius", [0.0, 0.004])
@pytest.mark.parametrize("name", ["plate", "ell", "knife"])
def test_meshes(name: str, radius: float, closed: bool) -> None:
    """Points and balls on thin and sharp solids and shells: every contact, and the whole state, to the bit."""
    rng = np.random.default_rng(5)
    vertices, faces = SHAPES[name]()
    M = flatten(vertices, faces, closed=closed)
    path = wandering(vertices, rng, 60)
    with plain_python():
        contacts, state, touches = along(path, M, radius, 0.01)
    others, other_state, _ = along(path, M, radius, 0.01)
    assert list(map(repr, contacts)) == list(map(repr, others))
    assert state.tobytes() == other_state.tobytes()
    assert touches > 5


def test_a_ball_in_a_corner_is_stopped_by_three_planes() -> None:
    """A box turned inside out is a room: the ball goes into its corner."""
    vertices, faces = plate(0.1, 0.1, 0.1)
    M = flatten(vertices, faces[:, ::-1], closed=True)
    path = np.linspace([0.0, 0.0, 0.0], [0.06, 0.055, 0.07], 40)
    with plain_python():
        contacts, state, _ = along(path, M, 0.004, np.inf)
    others, other_state, touches = along(path, M, 0.004, np.inf)
    assert list(map(repr, contacts)) == list(map(repr, others))
    assert state.tobytes() == other_state.tobytes()
    assert touches > 5
    proxy_of_ball = MeshFinger(state).last
    np.testing.assert_allclose([proxy_of_ball.x, proxy_of_ball.y, proxy_of_ball.z], 0.046, rtol=0.0, atol=1e-15)
