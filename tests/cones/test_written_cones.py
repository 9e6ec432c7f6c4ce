"""Kernels of the cones as they are written, run by Python itself, give the bits of the lowered ones."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.records import Floats, Many, Table
from graspfx.cones import complement as complementarity
from graspfx.cones import cone, friction
from graspfx.cones.complement import Contacts
from graspfx.cones.cone import HALF_SPACE, NO_CONE
from graspfx.cones.problem import ConeContact, FrictionProblem, Gains, ModePart, Unknown, problem_size, set_up
from graspfx.spatial import Matrix, Vector, Vector4
from tests.support.written import plain_python


def random_problem(rng: np.random.Generator, n: int, d: int, room: int) -> FrictionProblem:
    """A problem with weights, limits, compliances, fingers without a force, and whatever start."""
    problem = set_up(np.zeros(problem_size(n, room)), 0, n, room)
    problem.limited, problem.compliant = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    contacts = problem.contacts
    contacts.array(ConeContact.weight)[:] = rng.choice([0.0, 0.5, 1.0, 1.7], n, p=[0.1, 0.2, 0.5, 0.2])
    cones = [0.0, 0.1, 0.5, 1.5, *([NO_CONE, HALF_SPACE] if problem.limited else [])]
    contacts.array(ConeContact.coefficient)[:] = rng.choice(cones, n)
    contacts.array(ConeContact.status)[:] = rng.choice([-1.0, 0.0, 1.0], n, p=[0.1, 0.6, 0.3])
    contacts.array(ConeContact.limit)[:] = rng.choice([0.1, 1.0, np.inf], n)
    contacts.array(ConeContact.compliance)[:] = rng.uniform(0.0, 0.1, n)
    contacts.array(ConeContact.displacement)[:, :d] = 0.01 * rng.normal(size=(n, d))
    contacts.array(ConeContact.base_force)[:, 0] = rng.choice([0.0, 0.7], n)
    problem.unknowns.array(Unknown.value)[:] = rng.normal(size=room) * (rng.random() < 0.5)
    problem.modes = count = int(rng.integers(0, min(6, n * d) + 1))
    problem.unknowns.array(Unknown.share)[: min(count, room)] = rng.choice([1.0, 0.3], min(count, room))
    Q = np.linalg.qr(rng.normal(size=(n * d, max(count, 1))))[0]
    for i in range(n):
        contacts[i].modes.array(ModePart.motion)[:count, :d] = Q[i * d : i * d + d, :count].T
    return problem


def copy(problem: FrictionProblem) -> FrictionProblem:
    return FrictionProblem(problem.buffer.copy())


@pytest.mark.parametrize("seed", range(30))
def test_friction_of_modes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, d = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    one = random_problem(rng, n, d, 6)
    other = copy(one)
    gains = Gains(*10.0 ** rng.uniform(0.0, 2.0, 2)) if seed % 7 else Gains(0.0, 0.0)
    coulomb = seed % 2 == 0
    with plain_python():
        answer = friction.friction_force(one, d, gains, coulomb, 2)
    assert friction.friction_force(other, d, gains, coulomb, 2) == answer
    assert one.buffer.tobytes() == other.buffer.tobytes()


@pytest.mark.parametrize("seed", range(20))
def test_friction_of_a_square(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, d = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    one = random_problem(rng, n, d, n * d)
    other = copy(one)
    A = rng.normal(size=(n * d, n * d))
    K = Table((A @ A.T + np.eye(n * d)).ravel() * (seed % 7 > 0), 0, n * d)
    with plain_python():
        answer = friction.friction_force_square(one, d, K, True, seed % 2 == 0, 2)
    assert friction.friction_force_square(other, d, K, True, seed % 2 == 0, 2) == answer
    assert one.buffer.tobytes() == other.buffer.tobytes()


@pytest.mark.parametrize("seed", range(20))
def test_pivoting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts = Contacts(int(rng.integers(1, 5)), int(rng.integers(1, 5)), seed % 3 == 0)
    n, m = contacts.count, contacts.count * contacts.coordinates
    A = rng.normal(size=(m, m))
    K, e = A @ A.T + 0.1 * np.eye(m), rng.normal(size=m)
    start = [K.ravel(), K @ e, K.diagonal(), (np.arange(m) % contacts.coordinates > 0).astype(float), np.ones(n), e]

    def run() -> list[bytes]:
        square, vector, diagonal, marks, state, displacement = (np.array(a, dtype=float) for a in start)
        M, q, D, engaged = Table(square, 0, m), Floats(vector), Floats(diagonal), Floats(state)
        if not contacts.whole:
            complementarity.release(M, q, m, Floats(marks), D)
        code = complementarity.complement(M, q, D, engaged, contacts, True, float(np.abs(vector).max()))
        complementarity.settle(M, q, Floats(displacement), engaged, contacts)
        return [bytes([code]), *(a.tobytes() for a in (square, vector, marks, state))]

    with plain_python():
        first = run()
    assert run() == first


@pytest.mark.parametrize("d", [1, 2, 3, 4])
def test_modes_in_contact_frames(d: int) -> None:
    rng = np.random.default_rng(2)
    n, count = 3, 5
    frames: Many[Matrix] = Many(Matrix, rng.normal(size=9 * n), 0, n)
    lead = 1 + (4 if d > 3 else 3) * n
    motions = Table(rng.normal(size=count * lead), 0, lead)
    one = random_problem(rng, n, d, 6)
    other = copy(one)
    with plain_python():
        friction.turn_modes(frames, motions, one, d, count)
    friction.turn_modes(frames, motions, other, d, count)
    assert one.buffer.tobytes() == other.buffer.tobytes()


def test_values() -> None:
    """Frames, lengths and slopes of 200 random forces, statuses and limits."""
    rng = np.random.default_rng(3)
    draws = [(rng.normal(size=12).tolist(), *rng.integers(0, 4, 2).tolist()) for _ in range(200)]

    def values() -> list[object]:
        found = list[object]()
        for x, status, k in draws:
            normal, d = Vector(*x[:3]), k + 1
            force, other = Vector4(*x[3:7]), Vector4(*x[7:11])
            face = cone.Face(status, normal, abs(x[11]))
            found += [
                cone.contact_frame(normal, min(d, 3)),
                cone.force_size(force, d),
                cone.shorten(force, d, abs(x[11])),
                cone.cone_slope(face, abs(x[0]), float(k % 2), other),
                cone.ball_slope(force, d, abs(x[11]), other),
            ]
        return found

    with plain_python():
        first = values()
    assert values() == first
