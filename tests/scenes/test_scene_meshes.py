"""The meshes on the shelf: what their maker makes, watertight, of the volume that geometry says, sound for contact."""

from __future__ import annotations

from math import pi, sin, tau
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial import cKDTree

from graspfx import plugins
from graspfx.surfaces.triangles.mesh import Mesh, load_mesh

MESHES = plugins.shelf("scenes") / "meshes"
NAMES = ("mug", "plate", "potato")
TRIANGLES = {"mug": (2000, 5000), "plate": (12, 12), "potato": (20480, 20480)}
SINGLE = 4e-6  # [mm]: half the last bit of a float32 near 64 mm


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    return plugins.load("scenes", MESHES / "make.py")


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def loaded(name: str) -> Mesh:
    return load_mesh(MESHES / f"{name}.ply", scale=1e-3)


def volume(v: Any, f: Any) -> float:
    """Sum of the signed tetrahedra over a surface: that of what it encloses, if it is closed and faces outwards."""
    a, b, c = (v[f[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def test_the_files_are_what_the_maker_makes(maker: ModuleType, name: str) -> None:
    """The corners agree to the rounding of the file, and the volume does; how a flat face is cut is free."""
    made, kept = maker.MAKERS[name](), loaded(name)
    corners, ours = np.unique(made.vertices, axis=0), 1e3 * kept.vertices
    for a, b in ((corners, ours), (ours, corners)):
        assert np.max(cKDTree(a).query(b)[0]) < np.sqrt(3.0) * SINGLE
    assert volume(1e3 * kept.vertices, kept.faces) == pytest.approx(volume(made.vertices, made.faces), rel=1e-7)


def test_the_maker_writes_them_again(maker: ModuleType, tmp_path: Path) -> None:
    maker.write(tmp_path)
    for name in NAMES:
        again, kept = load_mesh(tmp_path / f"{name}.ply", scale=1e-3), loaded(name)
        assert len(again.faces) == len(kept.faces)


def test_they_are_closed_of_one_piece_and_need_no_repair(name: str) -> None:
    """Every side of a triangle lies at one other, run through the other way; chi = v - e + f is that of the shape."""
    mesh = loaded(name)
    assert mesh.notes == () and not mesh.shell
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    there, back = {tuple(side) for side in sides.tolist()}, {tuple(side[::-1]) for side in sides.tolist()}
    assert there == back and len(there) == len(sides)
    least, most = TRIANGLES[name]
    assert least <= len(mesh.faces) <= most
    holes = {"mug": 1}.get(name, 0)  # the handle's
    assert len(mesh.vertices) - len(sides) // 2 + len(mesh.faces) == 2 - 2 * holes


def test_the_plate_holds_its_edges_product() -> None:
    mesh = loaded("plate")
    assert volume(mesh.vertices, mesh.faces) == pytest.approx(0.08 * 0.06 * 0.001, rel=1e-14)


def test_the_mug_holds_what_its_parts_do(maker: ModuleType) -> None:
    """Prisms over regular polygons, exactly, and the torus outside the wall, within 1 % for its facets.

    A k-gon has sin(tau/k)/(tau/k) of its circle's area; a torus of such rings, that share for each of its circles.
    """
    share = {k: sin(tau / k) / (tau / k) for k in (maker.AROUND, maker.RING_AROUND, maker.TUBE_AROUND)}
    H, R, r = maker.HEIGHT, maker.OUTER, maker.INNER
    body = pi * share[maker.AROUND] * (R**2 * H - r**2 * (H - maker.FLOOR))
    ring, tube = maker.RING, maker.TUBE

    def beyond_wall(y: float) -> float:
        """Compute what of the torus at this y, an annulus of radii RING -+ h about x = R, lies beyond the wall."""
        h, wall = (tube**2 - y**2) ** 0.5, (R**2 - y**2) ** 0.5 - R

        def disc(a: float) -> float:
            return a**2 * np.arccos(wall / a) - wall * (a**2 - wall**2) ** 0.5

        return float(disc(ring + h) - disc(ring - h))

    handle = quad(beyond_wall, -tube, tube)[0] * share[maker.RING_AROUND] * share[maker.TUBE_AROUND]
    mesh = loaded("mug")
    assert abs(1e9 * volume(mesh.vertices, mesh.faces) - body - handle) < 0.01 * handle


def test_the_potato_holds_the_integral_of_its_radius() -> None:
    """V = 1/3 integral r^3 over the sphere, here by Gauss and equal steps; the facets take less than 0.3 % of it."""
    z, weights = np.polynomial.legendre.leggauss(200)
    angle = tau * np.arange(400) / 400
    s = np.sqrt(1.0 - z**2)[:, None]
    x, y, up = s * np.cos(angle), s * np.sin(angle), np.broadcast_to(z[:, None], (200, 400))
    bumps = np.sin(2 * x + 1) * np.sin(3 * y) + np.sin(3 * up + 1) * np.cos(2 * x) / 2
    bumps += np.sin(5 * y + 2) * np.sin(4 * up + 1) / 4
    expected = float(weights @ ((0.04 * (1 + 0.08 * bumps)) ** 3).sum(axis=1)) * tau / 400 / 3
    mesh = loaded("potato")
    assert 0.0 < 1.0 - volume(mesh.vertices, mesh.faces) / expected < 0.003
