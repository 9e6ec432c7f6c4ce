"""Triangle meshes that the tests touch, made here: plate, L, bumpy sphere, knife, needle, mug."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from graspfx.surfaces.triangles.tree import flatten

FloatArray = NDArray[np.float64]
Surface = tuple[FloatArray, NDArray[np.intp]]


def surface(mesh: Any) -> Surface:
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.intp)


def plate(x: float = 0.1, y: float = 0.08, z: float = 0.001) -> Surface:
    """Full edges [m] about the centre; twelve triangles."""
    return surface(trimesh.creation.box(extents=(x, y, z)))


def bumpy_sphere(subdivisions: int = 5, radius: float = 0.04, height: float = 0.1) -> Surface:
    """20 480 triangles at five subdivisions; bumps of a tenth of the radius."""
    v, f = surface(trimesh.creation.icosphere(subdivisions=subdivisions))
    bumps = np.sin(7 * v[:, 0]) * np.sin(6 * v[:, 1] + 0.3) * np.sin(8 * v[:, 2] + 0.7)
    return v * (radius * (1 + height * bumps))[:, None], f


def prism(outline: FloatArray, caps: NDArray[np.intp], height: float) -> Surface:
    """An outline (k, 2), counter-clockwise, pulled up by `height`; `caps` are triangles of it."""
    k = len(outline)
    low = np.column_stack([outline, np.zeros(k)])
    i, j = np.arange(k), (np.arange(k) + 1) % k
    sides = np.vstack([np.column_stack([i, j, j + k]), np.column_stack([i, j + k, i + k])])
    return np.vstack([low, low + np.array([0.0, 0.0, height])]), np.vstack([caps[:, ::-1], caps + k, sides])


def ell(arm: float = 0.06, width: float = 0.02, height: float = 0.03) -> Surface:
    """Two arms at a right angle: one concave edge."""
    outline = np.array([[0, 0], [arm, 0], [arm, width], [width, width], [width, arm], [0, arm]])
    return prism(outline, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]), height)


def knife(length: float = 0.1, width: float = 0.03, back: float = 0.0005) -> Surface:
    """A blade, one degree at its edge."""
    outline = np.array([[0, -back / 2], [width, 0], [0, back / 2]])
    return prism(outline, np.array([[0, 1, 2]]), length)


def needle(length: float = 0.05, thickness: float = 0.001, sides: int = 7) -> Surface:
    """A pyramid with a sharp tip."""
    v, f = surface(trimesh.creation.cone(radius=thickness, height=length, sections=sides))
    return v, f


def sheet(size: float = 0.1, cells: int = 6) -> Surface:
    """An open, slightly curved sheet seen from above."""
    t = np.linspace(-size / 2, size / 2, cells + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(t, t, indexing="ij"))
    k = cells + 1
    a = (np.arange(cells)[:, None] * k + np.arange(cells)).ravel()
    faces = np.vstack([np.column_stack([a, a + k, a + k + 1]), np.column_stack([a, a + k + 1, a + 1])])
    return np.column_stack([x, y, 2.0 * x * x - y * y]), faces


def mug() -> Surface:
    """A cup of 80 mm with walls of 3 mm and a handle, by trimesh's booleans."""
    pytest.importorskip("manifold3d")
    outer = trimesh.creation.cylinder(radius=0.04, height=0.09, sections=96)
    inner = trimesh.creation.cylinder(radius=0.037, height=0.09, sections=96)
    inner.apply_translation([0, 0, 0.004])
    ring = trimesh.creation.torus(major_radius=0.025, minor_radius=0.004, major_sections=48, minor_sections=24)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    ring.apply_translation([0.045, 0, 0])
    return surface(trimesh.boolean.difference([trimesh.boolean.union([outer, ring]), inner]))


SHAPES = {"plate": plate, "ell": ell, "bumpy": lambda: bumpy_sphere(3), "knife": knife, "needle": needle, "mug": mug}


def flat(name: str) -> FloatArray:
    """The array that the kernels read of a shape."""
    return flatten(*SHAPES[name](), closed=True)


def shifted(M: FloatArray, m: int) -> FloatArray:
    """Shift everything from entry m on, with nothing before it."""
    return np.concatenate([np.full(m, np.nan), M])


def surface_point(vertices: FloatArray, faces: NDArray[np.intp], count: int, rng: np.random.Generator) -> FloatArray:
    """Points (count, 3) on the triangles, each as likely as any other."""
    corners = vertices[faces[rng.integers(len(faces), size=count)]]
    points: FloatArray = (corners * rng.dirichlet([1.0, 1.0, 1.0], size=count)[:, :, None]).sum(axis=1)
    return points
