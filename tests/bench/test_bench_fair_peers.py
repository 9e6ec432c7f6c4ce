"""Peers of the benchmarks at their best give the numbers of the plain ones: what is quicker is no other problem."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.stability.one_gain import external_limit_map
from graspfx.bench.case import Case
from graspfx.bench.cases import batches, ticks
from graspfx.bench.cases.contact_sets import contact_sets
from graspfx.bench.cases.eq4_fixed import fixed_case
from graspfx.bench.measure import check
from graspfx.bench.oracles.map_oracle import crossing
from graspfx.bench.peers.arrays import last_positions, one_dof
from graspfx.bench.peers.eq4_many_peers import MANY_PEERS, stacked_matrices
from graspfx.bench.peers.eq4_peers import PEERS, closed_form, grasp_matrix
from graspfx.bench.peers.limit_peers import by_control, by_eigenvalues
from graspfx.bench.peers.paper import PaperProgram, Springs, coupling, rotation_matrix
from graspfx.bench.peers.projection_peers import ByClarabel
from graspfx.bench.peers.springs import MuJoCoSprings
from graspfx.bench.threads import NAMES, environment, one_blas_thread

T = 0.005


def plainly(g: Springs, count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield fingers and object by the equations as they stand, P anew in every tick, by semi-implicit Euler."""
    x, v = g.start.copy(), np.zeros_like(g.start)
    d = g.dimensions
    position, velocity, R = np.zeros(d), np.zeros(d), np.eye(d)
    angle, spin, q = 0.0, np.zeros({1: 0, 2: 1, 3: 3}[d]), np.array([0.0, 0.0, 0.0, 1.0])
    for _ in range(count):
        forces, wrench = coupling(g, x, position, R)
        v = v + g.T * (g.hand * (g.rest - x) - g.finger_friction * v - forces) / g.finger_mass
        x = x + g.T * v
        velocity = velocity + g.T * (wrench[:d] - g.viscosity * velocity) / g.mass
        position = position + g.T * velocity
        spin = spin + g.T * (wrench[d:] - g.rotational_viscosity * spin) / g.inertia
        if d == 2:
            angle += g.T * spin[0]
        if d == 3:
            q = q + 0.5 * g.T * np.append(spin * q[3] + np.cross(spin, q[:3]), -spin @ q[:3])
            q /= np.linalg.norm(q)
        R = rotation_matrix(d, angle, q)
        yield x, position


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("internal", [ticks.EXTERNAL, ticks.INTERNAL])
def test_program_that_knows_the_stiffness_is_the_paper_s(d: int, internal: float) -> None:
    g = ticks.springs(ticks.make_scene(d, internal, "native"), internal)
    program = PaperProgram(g)
    for x, position in plainly(g, 300):
        program.tick()
        np.testing.assert_allclose(program.fingers, x, rtol=0, atol=1e-15)
        np.testing.assert_allclose(program.position, position, rtol=0, atol=1e-15)
    assert np.abs(program.position).max() > 1e-3
    program.reset()
    program.tick()
    forces, _ = coupling(g, g.start, np.zeros(d), np.eye(d))
    np.testing.assert_allclose(program.forces, forces, rtol=0, atol=1e-15)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_rollout_is_the_steps_one_by_one(d: int) -> None:
    pytest.importorskip("mujoco")
    peer = MuJoCoSprings(ticks.springs(ticks.make_scene(d, ticks.EXTERNAL, "native"), ticks.EXTERNAL))
    position, rotation = peer.pose(peer.rollout(50)[-1])
    peer.reset()
    for _ in range(50):
        peer.tick()
    np.testing.assert_array_equal(position, peer.position)
    np.testing.assert_array_equal(rotation, peer.rotation())


def test_grasp_matrix_and_every_projection_are_the_public_ones() -> None:
    rng = np.random.default_rng(0)
    for n in (3, 5, 12):
        points, x = 0.05 * rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
        G = grasp_matrix(points)
        np.testing.assert_array_equal(G, gx.grasp_matrix(points))
        expected = gx.Grasp(points).split().project(x.ravel())
        for name, project in PEERS.items():
            np.testing.assert_allclose(project(G, x.ravel()), expected, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(closed_form(points, x).ravel(), expected, atol=1e-13)


def test_stacked_peers_are_the_single_ones() -> None:
    rng = np.random.default_rng(1)
    points, x = 0.05 * rng.normal(size=(7, 5, 3)), rng.normal(size=(7, 5, 3))
    np.testing.assert_array_equal(stacked_matrices(points), gx.grasp_matrix(points))
    expected = gx.Grasp(points).split().project(x.reshape(7, 15))
    for name, project in MANY_PEERS.items():
        np.testing.assert_allclose(project(points, x).reshape(7, 15), expected, atol=1e-12, err_msg=name)


def test_fixed_contacts_give_the_same_forces_by_every_method() -> None:
    case = fixed_case(next(each for each in contact_sets(quick=True) if each.name == "5 fingers"))
    names = [method.name for method in case.methods]
    assert "GraspFX Coupling.force, split known" in names and "numpy, K known" in names
    for row in (check(case, method) for method in case.methods):
        assert row.state == "missing" or (row.error is not None and row.error < 1e-13)


def test_arrays_of_numpy_are_single_runs() -> None:
    scene = gx.load("reference-1dof")
    stiffness, viscosity, mass = [20.0, 45.0], [0.7, 1.2], [0.08, 0.15]
    last = last_positions(one_dof(scene), np.array(stiffness), np.array(viscosity), np.array(mass), 300)
    for k in range(2):
        changed = scene.replace(
            {batches.STIFFNESS: stiffness[k], batches.VISCOSITY: viscosity[k], batches.MASS: mass[k]}
        )
        run = gx.run(changed, duration=300 * scene.period)
        expected = [*run.finger_position[-1, :, 0], *run.object_position[-1]]
        np.testing.assert_allclose(last[k], expected, rtol=1e-11)


def test_a_batch_is_timed_as_a_whole_call_and_gives_the_bits_of_single_runs() -> None:
    pytest.importorskip("llvmlite")
    rng = np.random.default_rng(2)
    values = {key: rng.uniform(*batches.RANGES[key], 18) for key in (batches.STIFFNESS, batches.VISCOSITY)}
    random = batches.BatchProblem(gx.load("reference-1dof"), values, ticks=60)
    (first, whole), arrays = batches.whole_calls(random, values), batches.by_numpy(random)
    assert (first.once, whole.once) == (True, False)
    assert (first.calls, whole.calls, arrays.calls) == (18, 18, 18)
    whole.call()
    case = Case("batches", "random", "relative", [whole, arrays], batches.BOUND)
    assert check(case, whole).error == 0.0
    assert 0.0 < (check(case, arrays).error or 0.0) < 1e-12


def test_eigenvalues_and_margins_meet_the_circle_where_30_digits_do() -> None:
    wall = [(0.15, 0.6, 33.0)]
    k = by_eigenvalues(wall, T)
    assert k == pytest.approx(crossing(wall, T, k), rel=1e-12)
    moved = [(0.1, 0.2, 33.0), (0.05, 0.4, 0.0)]
    known = external_limit_map(0.1, 0.2, T, 0.1, 0.8, spring=33.0)  # the closed form
    assert by_eigenvalues(moved, T) == pytest.approx(float(known), rel=1e-12)
    pytest.importorskip("control")
    assert by_control(moved, T, "best") == pytest.approx(float(known), rel=1e-6)


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_solver_that_is_given_new_numbers_is_a_new_solver(mu: float) -> None:
    pytest.importorskip("clarabel")
    rng = np.random.default_rng(1)
    solver = ByClarabel(6, mu, 1e-10)
    for _ in range(5):
        A = rng.normal(size=(6, 6))
        W, e = A @ A.T + np.eye(6), rng.normal(size=6)
        fresh = ByClarabel(6, mu, 1e-10)(W, e)
        np.testing.assert_allclose(solver(W, e), fresh, atol=1e-7)
        if mu == 0.0:
            assert (fresh[[1, 2, 4, 5]] == 0.0).all() and (fresh > -1e-7).all()


def test_one_blas_thread_is_for_what_is_loaded_within(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(NAMES[0], "7")
    for name in NAMES[1:]:
        monkeypatch.delenv(name, raising=False)
    with one_blas_thread():
        assert [os.environ[name] for name in NAMES] == ["7", "1", "1", "1"]
        assert not set(NAMES) & set(environment())
    assert [os.environ.get(name) for name in NAMES] == ["7", None, None, None]
