"""Contact and bodies beside other programs: errors within what they should be, closed forms against integration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from graspfx.bench.case import Case, is_installed
from graspfx.bench.cases import mesh_fingers, rigid_bodies
from graspfx.bench.oracles.brute_force import brute_force, perpendicular_feet
from graspfx.bench.oracles.closed_forms import turned_freely, turned_steadily, viscous_motion
from graspfx.errors import MissingPackageError


def errors(case: Case) -> dict[str, float]:
    """List errors by method; those that are not installed are left out."""
    found = {}
    for method in case.methods:
        try:
            found[method.name] = float(method.error() if callable(method.error) else method.error)
        except MissingPackageError:
            continue
    return found


def interpreted(package: str) -> bool:
    """Pretend that there is no compiler: the kernels are compiled in tests of their own."""
    return package != "llvmlite" and is_installed(package)


@pytest.fixture(scope="module")
def touched() -> dict[str, dict[str, float]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_fingers, "is_installed", interpreted)
        return {case.name: errors(case) for case in mesh_fingers.cases(quick=True)}


def test_contact_points_are_those_of_brute_force(touched: dict[str, dict[str, float]]) -> None:
    """Ours to the last digits of points 40 mm from the origin, on convex surfaces and on a plate pressed through."""
    assert len(touched) == 3
    for name, found in touched.items():
        ours = [error for method, error in found.items() if method.startswith("GraspFX")]
        assert ours, name
        assert max(ours) < 1e-17


def test_a_nearest_point_is_on_the_wrong_side_of_a_thin_plate(touched: dict[str, dict[str, float]]) -> None:
    """Fingers 6 mm deep: who looks for the nearest point now is off by all of that; on spheres it is to 0.1 mm."""
    for name, found in touched.items():
        for method in ("trimesh", "coal"):
            if method in found:
                assert found[method] == pytest.approx(0.006, rel=1e-9) if "plate" in name else found[method] < 1e-4


def test_what_a_finger_is_held_by_contains_the_nearest_point() -> None:
    """Inside a convex surface, the nearest of the perpendiculars' feet is the nearest point."""
    path = mesh_fingers.on_sphere(1, every=8)
    for p in np.random.default_rng(0).uniform(-0.015, 0.015, size=(20, 3)):
        nearest, distance = brute_force(path.vertices, path.faces, p)
        ways = perpendicular_feet(path.vertices, path.faces, p, 0.0) - p
        assert np.sqrt((ways * ways).sum(axis=1)).min() == distance
        assert np.abs(ways + p - nearest).sum(axis=1).min() == 0.0


def test_errors_of_bodies_are_those_of_their_methods(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact: rounding on a line and for a cube, fourth order for a box; it and implicit take any viscosity."""
    monkeypatch.setattr(rigid_bodies, "is_installed", interpreted)
    for case in rigid_bodies.cases(quick=True):
        found = errors(case)
        exact = found["GraspFX exact, interpreted"]
        [bound] = [method.bound for method in case.methods if method.name == "GraspFX exact, interpreted"]
        assert bound is not None
        assert exact <= bound, case.name
        if "b T/m" in case.name:
            assert found["GraspFX implicit, interpreted"] < 0.01
            assert all("refuses" in m.note for m in case.methods if m.name == "GraspFX explicit, interpreted") == (
                "1000" in case.name or "10" in case.name
            )
        elif "box" not in case.name:
            assert exact < 1e-13
        if "T = 5 ms" in case.name and "box" in case.name:
            assert exact < 1e-8
        for peer in ("PyBullet", "MuJoCo RK4", "MuJoCo Euler"):
            if peer in found and "b T/m" not in case.name:
                assert exact < 1.1 * found[peer] < 0.11  # first order at 20 ms is off by a tenth


def test_viscous_motion_is_the_matrix_exponential() -> None:
    """Forces that change every sample."""
    T, m, b, v = 0.005, 0.1, 0.8, 0.3
    forces = np.random.default_rng(0).normal(size=200).tolist()
    E = expm(T * np.array([[0, 1, 0], [0, -b / m, 1 / m], [0, 0, 0]]))
    y, largest = np.array([0.0, v]), 0.0
    for force in forces:
        y = (E @ np.append(y, force))[:2]
        largest = max(largest, abs(y[0]))
    np.testing.assert_allclose(viscous_motion(T, m, b, v, forces), [*y, largest], rtol=1e-13)


def test_a_free_box_turns_as_integrated() -> None:
    """Euler's equations and the quaternion's, DOP853 at 1e-13."""
    moments, spin = np.array([3e-5, 5e-5, 6e-5]), (4.0, 0.0, 6.0)

    def rate(_: float, y: Any) -> Any:
        w, v = y[4:], y[:3]
        turn = [*(0.5 * (y[3] * w + np.cross(v, w))), -0.5 * w @ v]
        return np.concatenate([turn, np.cross(moments * w, w) / moments])

    q = solve_ivp(rate, (0.0, 1.0), [0, 0, 0, 1, *spin], method="DOP853", rtol=1e-13, atol=1e-15).y[:4, -1]
    found = rigid_bodies.quaternion_of(turned_freely(moments.tolist(), spin, 1.0))
    assert rigid_bodies.angle_between(q / np.linalg.norm(q), found) < 1e-11


def test_a_cube_that_slows_down_turns_about_its_axis() -> None:
    """2 rad/s that decay at 3 per second for 0.5 s: (1 - exp(-1.5)) 2/3 rad; without decay 1 rad."""
    for rate, angle in ((3.0, (1.0 - np.exp(-1.5)) * 2.0 / 3.0), (0.0, 1.0)):
        q = turned_steadily((0.0, 2.0, 0.0), rate, 0.5)
        np.testing.assert_allclose(q, [0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)], rtol=1e-15)
