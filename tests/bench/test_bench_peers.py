"""The benchmarks' peers and oracles: what is quicker solves no other problem, and answers are as exact as they say."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx.bench.eq4 import EXTERNAL, INTERNAL, GraspMatrix, exact_force
from graspfx.bench.timing import Case, check
from tests.bench import batches, bodies, contact, creep, eq4, maps, peers, projection, runs
from tests.support.brute_force import brute_force, perpendicular_feet
from tests.support.closed_forms import turned_freely, turned_steadily, viscous_motion
from tests.support.exact import distance
from tests.support.exact import exact_force as exact_force_by_mpmath

T = 0.005


def errors(case: Case) -> dict[str, float]:
    """List errors by method; those that are not installed, or refused, are left out."""
    rows = [check(case, method) for method in case.methods]
    return {row.method: row.error for row in rows if row.error is not None and row.state == "timed"}


def plainly(g: peers.Springs, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fingers, forces and the cube's place by the equations as they stand, P anew in every tick."""
    x, v = g.start.copy(), np.zeros_like(g.start)
    p, u, w, q = np.zeros(3), np.zeros(3), np.zeros(3), np.array(peers.START)
    positions, all_forces = [], []
    for _ in range(count):
        forces, wrench = runs.coupling(g, x, p, peers.rotation_matrix(q))
        v = v + g.T * (g.hand * (g.rest - x) - g.finger_friction * v - forces) / g.finger_mass
        x = x + g.T * v
        u = u + g.T * (wrench[:3] - g.viscosity * u) / g.mass
        p = p + g.T * u
        w = w + g.T * (wrench[3:] - g.rotational_viscosity * w) / g.inertia
        q = q + 0.5 * g.T * np.append(w * q[3] + np.cross(w, q[:3]), -w @ q[:3])
        q /= np.linalg.norm(q)
        positions.append(x)
        all_forces.append(forces)
    return np.array(positions), np.array(all_forces), p


@pytest.mark.parametrize(
    ("package", "make"), [("numpy", peers.InNumpy), ("numba", peers.InNumba), ("jax", peers.InJax)]
)
@pytest.mark.parametrize("internal", [runs.EXTERNAL, runs.INTERNAL])
def test_program_that_knows_the_stiffness_is_the_paper_s(
    package: str, make: Callable[[peers.Springs], Any], internal: float
) -> None:
    pytest.importorskip(package)
    g = runs.springs(internal)
    program = make(g)
    place, _ = program.run(300)
    positions, forces, p = plainly(g, 300)
    np.testing.assert_allclose(program.positions, positions, rtol=0, atol=3e-15)
    np.testing.assert_allclose(program.forces, forces, rtol=0, atol=3e-13)
    np.testing.assert_allclose(place, p, rtol=0, atol=3e-15)
    assert np.abs(p).max() > 1e-3


def test_the_loops_of_numba_are_right_as_python_too() -> None:
    g = runs.springs(runs.INTERNAL)
    numbers = [g.T, g.finger_mass, g.finger_friction, g.hand, g.mass, g.inertia, g.viscosity, g.rotational_viscosity]
    x, f = np.empty((30, 5, 3)), np.empty((30, 5, 3))
    peers.loops(np.array(numbers), g.K, g.anchors, g.start, g.rest, x, f)
    np.testing.assert_allclose(x, plainly(g, 30)[0], rtol=0, atol=1e-15)


def test_every_program_tends_to_the_motion_that_is_not_sampled() -> None:
    """Half the period has half the error: all are of first order, about one and the same truth."""
    pytest.importorskip("mujoco")
    found = []
    for period in (0.001, 0.0005):
        g = runs.springs(runs.EXTERNAL, period)  # MuJoCo's springs have one gain
        truth, ticks = runs.anchors_after(g), round(runs.SECONDS / period)
        ours = runs.run_error(runs.scene(runs.EXTERNAL, period=period), truth, g)
        found.append(
            [ours, *(runs.anchor_error(make(g).run(ticks), truth, g) for make in (peers.InNumpy, peers.InMuJoCo))]
        )
    np.testing.assert_allclose(np.divide(found[0], found[1]), 2.0, rtol=0.15)
    assert runs.anchor_error((np.zeros(3), np.eye(3)), truth, g) > 1e-3  # the truth moves


def test_on_pybullet_the_bare_calls_are_the_run_s() -> None:
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    own, bare = errors(runs.on_bullet(1000)).values()
    assert own == pytest.approx(bare, abs=1e-12)


def test_the_reader_s_coupling_is_the_public_one() -> None:
    g = runs.springs(runs.INTERNAL)
    fingers = g.start + np.random.default_rng(3).normal(size=g.start.shape) * 0.005
    forces, wrench = runs.coupling(g, fingers, np.zeros(3), np.eye(3))
    law = gx.Coupling(external=gx.Impedance(g.external), internal=gx.Impedance(g.internal))
    G, e = gx.grasp_matrix(g.anchors), (fingers - g.anchors).ravel()
    np.testing.assert_allclose(forces.ravel(), law.force(gx.Split(G), e), rtol=0, atol=1e-14)
    np.testing.assert_allclose(wrench, G @ forces.ravel(), atol=1e-15)


def test_fractions_give_the_force_of_50_digits_and_every_way_that_force() -> None:
    """Two oracles, one of fractions and one of mpmath, and each peer to rounding, where contacts are good."""
    rng = np.random.default_rng(0)
    for n in (3, 5, 12):
        points, e = 0.05 * rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
        exact = exact_force(points, e)
        assert distance(exact, exact_force_by_mpmath(points, e, EXTERNAL, INTERNAL, 1e-12)[0]) < 1e-13
        np.testing.assert_array_equal(GraspMatrix(n)(points), gx.grasp_matrix(points))
        ways = [eq4.by_moments, eq4.moments_in_loops, eq4.stacked]
        for way in ways:
            np.testing.assert_allclose(way(points, e), exact, rtol=0, atol=1e-12)


def test_ways_for_many_grasps_are_right() -> None:
    """By every method that is installed."""
    found = errors(eq4.many(100))
    assert max(found.values()) < 1e-13 and {"numpy pinv, stacked", "numpy, closed form, stacked"} <= set(found)


def test_contact_points_are_those_of_brute_force_and_a_nearest_point_is_not() -> None:
    """On a plate of 1 mm fingers are deeper than it is thick: who looks for the nearest point is off by all of that."""
    for case in contact.cases(quick=True):
        found = errors(case)
        assert found["GraspFX, whole tick"] < 1e-17
        for method in ("trimesh", "coal"):
            if method in found:
                assert found[method] > 0.006 if "plate" in case.name else found[method] < 1e-15
    pressed = contact.on_sphere(1)
    depth = 0.04 - np.linalg.norm(pressed.places, axis=2)
    assert depth.max() > 0.004 and depth.min() < 0.0  # they come from outside


def test_what_a_finger_is_held_by_contains_the_nearest_point() -> None:
    """Inside a convex surface, the nearest of the perpendiculars' feet is the nearest point."""
    pressed = contact.on_sphere(1)
    for p in np.random.default_rng(0).uniform(-0.015, 0.015, size=(20, 3)):
        nearest, away = brute_force(pressed.vertices, pressed.faces, p)
        ways = perpendicular_feet(pressed.vertices, pressed.faces, p, 0.0) - p
        assert np.sqrt((ways * ways).sum(axis=1)).min() == away
        assert np.abs(ways + p - nearest).sum(axis=1).min() == 0.0


def test_errors_of_bodies_are_those_of_their_methods() -> None:
    """Exact: rounding on a line and for a cube, fourth order for a box; others of first order are off by a per cent."""
    for case in bodies.cases(quick=True):
        found = errors(case)
        assert found["GraspFX exact"] < (1e-8 if "box" in case.name else 1e-13), case.name
        assert 1e-6 < found["GraspFX implicit"] < 0.1
        for peer in ("PyBullet", "MuJoCo RK4", "MuJoCo Euler"):
            if peer in found:
                assert found["GraspFX exact"] < 1.1 * found[peer] < 0.11


def test_viscous_motion_is_the_matrix_exponential() -> None:
    """Forces that change every sample."""
    m, b, v = 0.1, 0.8, 0.3
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
    found = Rotation.from_matrix(turned_freely(moments.tolist(), spin, 1.0)).as_quat()
    assert bodies.angle_between(q / np.linalg.norm(q), found) < 1e-11


def test_a_cube_that_slows_down_turns_about_its_axis() -> None:
    """2 rad/s that decay at 3 per second for 0.5 s: (1 - exp(-1.5)) 2/3 rad; without decay 1 rad."""
    for rate, angle in ((3.0, (1.0 - np.exp(-1.5)) * 2.0 / 3.0), (0.0, 1.0)):
        q = turned_steadily((0.0, 2.0, 0.0), rate, 0.5)
        np.testing.assert_allclose(q, [0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)], rtol=1e-15)


def test_peers_of_batches_are_single_runs() -> None:
    """By every method that is installed."""
    rng = np.random.default_rng(2)
    values = {key: rng.uniform(*each, 18) for key, each in batches.RANGES.items()}
    variants = batches.Variants(gx.load("reference-1dof"), values, ticks=60)
    found = errors(Case("batches", "random", "relative", list(batches.peers(variants)), batches.BOUND))
    assert "numpy, arrays of variants" in found and all(0.0 < error < 1e-12 for error in found.values())


def test_a_batch_has_the_bits_of_single_runs() -> None:
    pytest.importorskip("llvmlite")
    values = {key: np.linspace(*each, 18) for key, each in batches.RANGES.items()}
    variants = batches.Variants(gx.load("reference-1dof"), values, ticks=60)
    assert variants.error(variants.batch) == 0.0


def test_eigenvalues_and_margins_meet_the_circle_where_30_digits_do() -> None:
    wall = [(0.15, 0.6, 33.0)]
    k = maps.by_eigenvalues(wall, T)
    assert k == pytest.approx(maps.crossing(wall, T, k), rel=1e-12)
    moved = [(0.1, 0.2, 33.0), (0.05, 0.4, 0.0)]
    known = gx.stability.external_limit_map(0.1, 0.2, T, 0.1, 0.8, spring=33.0)  # the closed form
    assert maps.by_eigenvalues(moved, T) == pytest.approx(float(known), rel=1e-12)
    pytest.importorskip("control")
    assert maps.by_control(moved, T, "best") == pytest.approx(float(known), rel=1e-6)


@pytest.mark.parametrize("mu", [0.0, projection.FRICTION])
def test_forces_in_cones_are_those_of_50_digits(mu: float) -> None:
    """The public call to rounding; the oracle's answers push, and slide at the coefficient or stick."""
    problems = projection.drawn(np.random.default_rng(1), 3, mu, 4, 3.0)
    normals = np.eye(3)[None, 0].repeat(4, axis=0)
    for p in problems:
        found = gx.unilateral_force(p.K, p.e, normals, mu).force
        np.testing.assert_allclose(found, p.force, rtol=0, atol=1e-13 * np.abs(p.force).max())
        f = p.force.reshape(4, 3)
        slip = np.linalg.norm(f[:, 1:], axis=1)
        assert (f[:, 0] >= 0.0).all() and (slip <= mu * f[:, 0] + 1e-12).all()
        swept = np.zeros(12)
        projection.gauss_seidel(p.W, p.e, swept, mu, 1e-13)
        np.testing.assert_allclose(swept, p.force, rtol=0, atol=1e-9 * np.abs(p.force).max())


def test_clarabel_finds_the_forces_without_friction() -> None:
    pytest.importorskip("clarabel")
    problems = projection.drawn(np.random.default_rng(1), 3, 0.0, 4, 3.0)
    solve = projection.ByClarabel(4, 1e-12)
    for p in problems:
        np.testing.assert_allclose(solve(p), p.force, rtol=0, atol=1e-7 * np.abs(p.force).max())


def test_a_pinched_box_creeps_in_mujoco_unless_it_projects_and_not_here() -> None:
    """Regularised friction: 150 um/s at impratio 10, ten times that at 1, more with pyramids; noslip, ours none."""
    pytest.importorskip("mujoco")
    [case] = creep.cases(quick=True)
    found = {name.rpartition(", ")[2]: 1e6 * error for name, error in errors(case).items()}
    assert found["whole tick"] < 1e-3 and found["noslip"] < 1.0
    assert 50.0 < found["impratio 10"] < 300.0
    assert found["elliptic"] == pytest.approx(10.0 * found["impratio 10"], rel=0.02)
    assert found["pyramidal"] > found["elliptic"]
