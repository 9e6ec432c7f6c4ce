"""Points on a ray at a distance from a shape: in closed form, against trimesh's rays, and outermost of all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from graspfx.surfaces.closed_form.shape import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Plane, Sphere
from graspfx.surfaces.standoff import standoff
from graspfx.surfaces.triangles.mesh import Mesh, make_mesh
from tests.support.scatter import rotation

FloatArray = NDArray[np.float64]

SHAPES: dict[str, tuple[Any, int]] = {
    "line": (Box((0.05,)), 1),
    "interval": (Sphere(0.02), 1),
    "square": (Box((0.05, 0.03)), 2),
    "disc": (Sphere(0.02), 2),
    "stadium": (Capsule(0.01, 0.04), 2),
    "ellipse": (Ellipsoid((0.03, 0.01)), 2),
    "box": (Box((0.05, 0.03, 0.07)), 3),
    "sphere": (Sphere(0.02), 3),
    "capsule": (Capsule(0.01, 0.04), 3),
    "cylinder": (Cylinder(0.015, 0.06), 3),
    "ellipsoid": (Ellipsoid((0.03, 0.01, 0.002)), 3),
}


def directions(d: int, count: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(count, d))


def at(shape: Any, u: FloatArray, distance: float) -> FloatArray:
    t = standoff(shape, u, distance)
    assert t is not None and t >= 0.0
    return t * u / np.linalg.norm(u)


@pytest.mark.parametrize("name", SHAPES)
def test_the_contact_has_that_gap(name: str) -> None:
    shape, d = SHAPES[name]
    for u in directions(d, 40):
        for distance in (0.0, 1e-6, 0.003, 0.5):
            point = at(shape, u, distance)
            assert shape.contact(point[None]).gap[0] == pytest.approx(distance, rel=1e-15, abs=2e-17)
            for t in np.linspace(1.0001, 3.0, 20):  # nowhere farther out is as near
                assert shape.contact((t * point)[None]).gap[0] > distance


@pytest.mark.parametrize(("radius", "distance"), [(0.03, 0.0), (0.03, 0.012)])
def test_spheres_and_boxes_in_closed_form(radius: float, distance: float) -> None:
    for u in directions(3, 20):
        assert np.allclose(at(Sphere(radius), u, distance), (radius + distance) * u / np.linalg.norm(u), rtol=1e-15)
    half = np.array([0.025, 0.015, 0.035])
    for u in directions(3, 20):
        on = at(Box(tuple((2.0 * half).tolist())), u, 0.0)
        assert np.allclose(on, u * (half / np.abs(u)).min(), rtol=1e-14)
    assert standoff(Box((0.05,)), np.array([-3.0]), distance) == pytest.approx(0.025 + distance, rel=1e-15)


def test_planes_and_half_spaces() -> None:
    n = np.array([0.0, 0.6, 0.8])
    for u in directions(3, 20):
        climb = float(n @ u) / float(np.linalg.norm(u))
        t = standoff(HalfSpace(tuple(n.tolist())), u, 0.01)
        assert t is None if climb <= 0.0 else t == pytest.approx(0.01 / climb, rel=1e-14)
        assert standoff(Plane(tuple(n.tolist())), u, 0.01) == pytest.approx(0.01 / abs(climb), rel=1e-14)
    assert standoff(Plane(tuple(n.tolist())), np.array([1.0, 0.0, 0.0]), 0.01) is None  # along it


def meshes() -> dict[str, trimesh.Trimesh]:
    """In metres: trimesh decides by absolute tolerances what a ray hits."""
    ring = trimesh.creation.torus(2.0, 0.5)
    parts = [trimesh.creation.box([1.0, 2.0, 3.0]), trimesh.creation.icosphere(2, 1.2)]
    parts[1].apply_translation([0.0, 3.0, 0.0])
    for each in (ring, *parts):
        each.apply_transform(
            np.vstack([np.column_stack([rotation(np.random.default_rng(3)), np.zeros(3)]), [0, 0, 0, 1]])
        )
    return {"ring": ring, "two": trimesh.util.concatenate(parts), "ball": trimesh.creation.icosphere(3, 1.0)}


def both(name: str) -> tuple[Mesh, trimesh.Trimesh]:
    other = meshes()[name]
    return make_mesh(np.array(other.vertices), np.array(other.faces), name="mesh"), other


@pytest.mark.parametrize("name", ["ring", "two", "ball"])
def test_against_the_last_hit_of_trimeshs_rays(name: str) -> None:
    """Points at no distance are outermost intersections; a ray that misses has none."""
    mesh, other = both(name)
    u = directions(3, 60, 1)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    points, rays, _ = other.ray.intersects_location(np.zeros_like(u), u, multiple_hits=True)
    hits = 0
    for i, direction in enumerate(u):
        along = (points[rays == i] @ direction).tolist()
        t = standoff(mesh, direction, 0.0)
        if not along:
            assert t is None
            continue
        hits += 1
        assert t == pytest.approx(max(along), rel=1e-9)
    assert hits >= 10 and (name != "ring" or hits < len(u))


@pytest.mark.parametrize("name", ["ring", "two", "ball"])
def test_distances_from_meshes_are_trimeshs(name: str) -> None:
    """The point is as far from the nearest triangle as asked for, and every point farther out is farther away."""
    mesh, other = both(name)
    count = 0
    for u in directions(3, 25, 2):
        t = standoff(mesh, u, 0.4)
        if t is None:
            continue
        count += 1
        way = np.linspace(t, t + 4.0, 30)[:, None] * u / np.linalg.norm(u)
        _, distance, _ = trimesh.proximity.closest_point(other, way)
        assert distance[0] == pytest.approx(0.4, rel=1e-12) and (distance[1:] > 0.4).all()
    assert count > 10


def test_a_ray_that_brushes_the_surface() -> None:
    """Along a face of a plate 2 mm below it, the last point is at the plate's edge; above it there is none."""
    plate = Box((0.08, 0.06, 0.002))
    assert standoff(plate, np.array([1.0, 0.0, 1e-9]), 0.0) == pytest.approx(0.04, rel=1e-12)
    assert standoff(Sphere(0.02), np.array([1e300, 0.0, 0.0]) / 1e300, 0.0) == pytest.approx(0.02, rel=1e-15)
